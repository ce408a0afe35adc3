import struct
import tracemalloc
import zlib

import cv2
import numpy as np
import pytest

from readygo.common.images.encoded import decode_image, decode_pixels, encoded_size_px

IMAGE = np.arange(20 * 30 * 3, dtype=np.uint8).reshape(20, 30, 3)


def _file(suffix: str) -> bytes:
    return cv2.imencode(suffix, IMAGE)[1].tobytes()


def _huge_png(width_px: int, height_px: int) -> bytes:
    """A few bytes that claim an image of this size."""
    header = b"IHDR" + struct.pack(">IIBBBBB", width_px, height_px, 8, 2, 0, 0, 0)
    data = b"IDAT" + zlib.compress(bytes(1000))
    chunks = [struct.pack(">I", len(c) - 4) + c + struct.pack(">I", zlib.crc32(c)) for c in (header, data, b"IEND")]
    return b"\x89PNG\r\n\x1a\n" + b"".join(chunks)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_size_is_known_before_anything_is_decoded(suffix: str) -> None:
    assert encoded_size_px(_file(suffix)) == (20, 30)
    assert encoded_size_px(memoryview(_file(suffix))) == (20, 30)
    pixels = decode_pixels(_file(suffix), cv2.IMREAD_COLOR)
    assert pixels is not None
    assert pixels.shape == IMAGE.shape


def test_fill_bytes_and_other_segments_of_a_jpeg_are_skipped() -> None:
    data = _file(".jpg")
    assert encoded_size_px(data[:2] + b"\xff\xff\xfe\x00\x04ab" + data[2:]) == (20, 30)


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_every_beginning_of_a_file_is_safe(suffix: str) -> None:
    data = _file(suffix)
    for end in range(0, len(data), 7):
        encoded_size_px(data[:end])


def test_image_that_claims_a_thousand_million_pixels_costs_nothing() -> None:
    tracemalloc.start()
    assert decode_pixels(_huge_png(2**15, 2**15), cv2.IMREAD_COLOR) is None
    jpeg = bytearray(_file(".jpg"))
    at = jpeg.index(b"\xff\xc0") + 5
    jpeg[at : at + 4] = b"\xff\xff\xff\xff"
    assert decode_pixels(jpeg, cv2.IMREAD_COLOR) is None
    assert tracemalloc.get_traced_memory()[1] < 1e6
    tracemalloc.stop()


def test_other_formats_and_damaged_files_are_none() -> None:
    assert decode_pixels(_file(".bmp"), cv2.IMREAD_COLOR) is None
    assert decode_pixels(b"", cv2.IMREAD_COLOR) is None
    assert decode_pixels(_file(".png")[:40], cv2.IMREAD_COLOR) is None


@pytest.mark.parametrize("suffix", [".png", ".jpg"])
def test_decoded_image_is_rgb(suffix: str) -> None:
    image = decode_image(_file(suffix))
    assert image is not None
    bgr = cv2.imdecode(np.frombuffer(_file(suffix), np.uint8), cv2.IMREAD_COLOR)
    np.testing.assert_array_equal(image, bgr[..., ::-1])
    assert decode_image(b"no image") is None
