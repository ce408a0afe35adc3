import os
import resource
import struct
import tracemalloc
import zlib
from collections.abc import Callable
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.common.images.encoded import PICTURES, decode_image, decode_pixels, encoded_size_px, read_pixels

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


def _chunk(kind: bytes, data: bytes, *, claim: int | None = None) -> bytes:
    length = len(data) if claim is None else claim
    return struct.pack(">I", length) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def _memory_mb(function: Callable[[], object]) -> int:
    """Memory that a process of its own takes at most for a call, beyond what it had [MB]."""
    receiver, sender = os.pipe()
    if not (child := os.fork()):
        begin_kb = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        function()
        os.write(sender, str(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - begin_kb).encode())
        os._exit(0)
    os.waitpid(child, 0)
    return int(os.read(receiver, 100)) // 1000


def test_chunk_that_claims_a_thousand_megabytes_costs_nothing() -> None:
    """OpenCV makes room for a PNG's chunk before it reads it: 14 kB took 1.07 GB."""
    data = _file(".png")[:33] + _chunk(b"IDAT", bytes(14_000), claim=1_080_000_000)
    assert _memory_mb(lambda: decode_pixels(data, cv2.IMREAD_COLOR)) < 50
    assert decode_pixels(data, cv2.IMREAD_COLOR) is None


def test_texts_of_a_png_are_not_unpacked() -> None:
    text = _chunk(b"zTXt", b"note\0\0" + zlib.compress(bytes(7_900_000), 9))
    data = _file(".png")[:33] + 200 * text + _file(".png")[33:]
    assert _memory_mb(lambda: decode_pixels(data, cv2.IMREAD_COLOR)) < 100
    pixels = decode_pixels(data, cv2.IMREAD_COLOR)
    assert pixels is not None
    np.testing.assert_array_equal(pixels, IMAGE)


def test_other_formats_are_decoded_where_they_are_wanted() -> None:
    for suffix in (".bmp", ".webp", ".tiff", ".ppm", ".png", ".jpg"):
        pixels = decode_pixels(_file(suffix), cv2.IMREAD_COLOR, formats=PICTURES)
        assert pixels is not None
        assert pixels.shape == IMAGE.shape
        assert decode_pixels(_file(suffix), cv2.IMREAD_COLOR, formats=PICTURES, pixels_max=599) is None
        for end in range(0, len(_file(suffix)), 11):
            decode_pixels(_file(suffix)[:end], cv2.IMREAD_COLOR, formats=PICTURES)


def test_photo_is_read_from_a_file_and_from_nothing_else(tmp_path: Path) -> None:
    (tmp_path / "a.png").write_bytes(_file(".png"))
    os.mkfifo(tmp_path / "pipe.png")
    np.testing.assert_array_equal(read_pixels(tmp_path / "a.png", cv2.IMREAD_COLOR), IMAGE)
    for name in ("pipe.png", "absent.png", ".", "a\0.png"):
        assert read_pixels(tmp_path / name, cv2.IMREAD_COLOR) is None
