import struct

import cv2
import numpy as np
import pytest

from readygo.apps.robot_logs.pixels import (
    ENCODINGS,
    bgr_of,
    compressed_depth,
    compressed_depth_of,
    depth_of,
    millimetres,
    pixels_of,
)

RED = {"bgr8": (0, 0, 255), "rgb8": (255, 0, 0), "rgba8": (255, 0, 0, 9), "bgra8": (0, 0, 255, 9)}


@pytest.mark.parametrize("encoding", RED)
def test_red_is_red_in_every_order_of_colours(encoding):
    pixels = np.tile(np.array(RED[encoding], np.uint8), (4, 6, 1))
    found = bgr_of(pixels, encoding=encoding, height_px=4, width_px=6, row_bytes=pixels.shape[2] * 6)
    assert (found == (0, 0, 255)).all()


@pytest.mark.parametrize(("encoding", "conversion"), [("yuyv", "YUY2"), ("yuv422", "UYVY")])
def test_cameras_that_send_luma_and_chroma_are_read(encoding, conversion):
    bgr = np.full((4, 6, 3), (20, 60, 200), np.uint8)
    sent = cv2.cvtColor(bgr, getattr(cv2, f"COLOR_BGR2YUV_{conversion}"))
    found = bgr_of(sent, encoding=encoding, height_px=4, width_px=6, row_bytes=12)
    assert np.abs(found.astype(int) - bgr).max() < 6


def test_all_encodings_give_three_channels_and_rows_may_be_padded():
    for encoding in ENCODINGS:
        found = bgr_of(np.zeros(8 * 40, np.uint8), encoding=encoding, height_px=8, width_px=8, row_bytes=40)
        assert found.shape == (8, 8, 3)


def test_unknown_encoding_and_wrong_sizes_are_said():
    with pytest.raises(ValueError, match="16UC1"):
        bgr_of(np.zeros(32, np.uint8), encoding="16UC1", height_px=4, width_px=4, row_bytes=8)
    with pytest.raises(ValueError, match="4x4 px rgb8 in 12 bytes"):
        bgr_of(np.zeros(12, np.uint8), encoding="rgb8", height_px=4, width_px=4, row_bytes=12)


def test_depths_are_read_in_millimetres_and_in_metres():
    millimetre = np.array([[1500, 0], [65535, 1]], ">u2")
    size = {"height_px": 2, "width_px": 2}
    found = pixels_of(
        np.frombuffer(millimetre.tobytes(), np.uint8), encoding="16UC1", row_bytes=4, big_endian=True, **size
    )
    assert np.array_equal(found, np.array([[1.5, np.inf], [65.535, 0.001]], np.float32))
    metres = np.array([[1.5, np.nan, 9.0], [np.inf, 0.0, 9.0]], np.float32)
    found = pixels_of(np.frombuffer(metres.tobytes(), np.uint8), encoding="32FC1", row_bytes=12, **size)
    assert np.array_equal(found, np.array([[1.5, np.inf], [np.inf, np.inf]], np.float32))


def test_depths_that_are_none_are_said():
    with pytest.raises(ValueError, match="depths of 4x4 px 16UC1 in 16 bytes of 4 a row"):
        depth_of(np.zeros(16, np.uint8), encoding="16UC1", height_px=4, width_px=4, row_bytes=4)
    with pytest.raises(ValueError, match="depths of encoding 'bgr8'; known: 16UC1, 32FC1"):
        depth_of(np.zeros(48, np.uint8), encoding="bgr8", height_px=4, width_px=4, row_bytes=12)
    assert millimetres(np.array([np.nan, -1.0, 66.0, 2.0], np.float32)).tolist() == [0, 0, 0, 2000]


def test_compressed_depths_come_back_as_they_were_to_the_millimetre():
    depth_m = np.array([[0.5, 1.2346], [np.inf, 60.0]], np.float32)
    data, image_format = compressed_depth(depth_m)
    assert (len(data[:12]), data[12:20]) == (12, b"\x89PNG\r\n\x1a\n")
    assert np.allclose(compressed_depth_of(data, image_format), [[0.5, 1.235], [np.inf, 60.0]])


def test_quantised_inverse_depths_are_read_as_ros_writes_them():
    # depth_max 10 m, depth_quantization 100: factor 100 * 101, offset 1 - factor / 10.
    factor, depth_m = 100.0 * 101.0, np.array([[1.0, 2.5, 8.0]])
    offset = 1.0 - factor / 10.0
    stored = np.round(factor / depth_m + offset).astype(np.uint16)
    stored[0, 2] = 0
    data = struct.pack("<iff", 0, factor, offset) + cv2.imencode(".png", stored)[1].tobytes()
    found = compressed_depth_of(data, "32FC1; compressedDepth png")
    assert np.allclose(found, [[1.0, 2.5, np.inf]], atol=1e-3)


@pytest.mark.parametrize(
    ("data", "image_format", "words"),
    [
        (b"\0" * 12 + b"x", "16UC1; compressedDepth png", "no PNG of 16 bits"),
        (b"\0" * 40, "16UC1; compressedDepth rvl", "known: 16UC1 or 32FC1; compressedDepth png"),
        (b"", "8UC1; compressedDepth png", "compressed depths of format '8UC1"),
    ],
)
def test_compressed_depths_that_are_none_are_said(data, image_format, words):
    with pytest.raises(ValueError, match=words):
        compressed_depth_of(data, image_format)


def test_size_that_an_encoding_cannot_have_is_refused() -> None:
    with pytest.raises(ValueError, match="a size that"):
        bgr_of(np.zeros(6, np.uint8), encoding="yuv422_yuy2", height_px=1, width_px=3, row_bytes=6)


@pytest.mark.parametrize("encoding", ENCODINGS)
def test_sizes_that_just_fit_are_read_and_a_byte_less_is_refused(encoding):
    channels = {"bgr8": 3, "8UC3": 3, "rgb8": 3, "rgba8": 4, "bgra8": 4}.get(encoding, 2 if "yu" in encoding else 1)
    channels = 2 if encoding in ("uyvy", "yuyv", "yuv422", "yuv422_yuy2") else channels
    size = {"encoding": encoding, "height_px": 4, "width_px": 6}
    rng = np.random.default_rng(1)
    data = rng.integers(0, 256, (4, 6 * channels), np.uint8)
    tight = bgr_of(data, row_bytes=6 * channels, **size)
    wide = bgr_of(np.pad(data, ((0, 0), (0, 3))), row_bytes=6 * channels + 3, **size)
    assert np.array_equal(tight, wide)
    for wrong, row_bytes in ((data[:, :-1], 6 * channels - 1), (data[:3], 6 * channels), (data[:0], 6 * channels)):
        with pytest.raises(ValueError, match="an image of 4x6 px"):
            bgr_of(wrong, row_bytes=row_bytes, **size)


@pytest.mark.parametrize("encoding", ["bayer_rggb8", "bayer_bggr8", "bayer_gbrg8", "bayer_grbg8"])
def test_mosaics_are_read_in_their_order(encoding):
    names = encoding[6:10]
    colour = {"r": 200, "g": 120, "b": 40}
    tile = np.array([[colour[names[0]], colour[names[1]]], [colour[names[2]], colour[names[3]]]], np.uint8)
    found = bgr_of(np.tile(tile, (6, 6)), encoding=encoding, height_px=12, width_px=12, row_bytes=12)
    assert (found[2:-2, 2:-2] == (40, 120, 200)).all()


def test_depths_of_padded_rows_and_the_largest_millimetre():
    stored = np.array([[1500, 65535, 7], [2, 0, 7]], "<u2")
    size = {"encoding": "16UC1", "height_px": 2, "width_px": 2}
    found = depth_of(stored.view(np.uint8), row_bytes=6, **size)
    assert np.array_equal(found, np.array([[1.5, 65.535], [0.002, np.inf]], np.float32))
    for data, row_bytes in ((stored.view(np.uint8)[:, :3], 3), (stored.view(np.uint8)[:1], 6)):
        with pytest.raises(ValueError, match="depths of 2x2 px 16UC1"):
            depth_of(data, row_bytes=row_bytes, **size)
    assert millimetres(np.array([65.535, 65.536, 0.0005, 0.0004, 0.0016], np.float32)).tolist() == [65535, 0, 0, 0, 2]
