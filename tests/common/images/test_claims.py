"""Sizes are read from headers; images that would cost more than their pixels claim nothing."""

import struct

import cv2
import numpy as np
import pytest

from readygo.common.images.claims import ImageClaim, ImageFormat, claim_of, plain_png

IMAGE = np.arange(20 * 30 * 3, dtype=np.uint8).reshape(20, 30, 3)
SUFFIXES = {
    ".png": ImageFormat.PNG,
    ".jpg": ImageFormat.JPEG,
    ".bmp": ImageFormat.BMP,
    ".webp": ImageFormat.WEBP,
    ".tiff": ImageFormat.TIFF,
    ".ppm": ImageFormat.PNM,
}


def _file(suffix: str, *parameters: int) -> bytes:
    return bytes(cv2.imencode(suffix, IMAGE, parameters)[1].tobytes())


@pytest.mark.parametrize(("suffix", "kind"), SUFFIXES.items())
def test_format_and_size_are_read_from_the_header(suffix: str, kind: ImageFormat) -> None:
    data = _file(suffix)
    assert claim_of(data) == claim_of(memoryview(data)) == ImageClaim(kind, 20, 30)
    for end in range(0, min(len(data), 2000), 3):
        assert claim_of(data[:end]) in (None, ImageClaim(kind, 20, 30))


def test_variants_of_webp_and_bmp_and_pnm_are_known() -> None:
    assert claim_of(_file(".webp", cv2.IMWRITE_WEBP_QUALITY, 101)) == ImageClaim(ImageFormat.WEBP, 20, 30)
    assert claim_of(_file(".webp", cv2.IMWRITE_WEBP_QUALITY, 50)) == ImageClaim(ImageFormat.WEBP, 20, 30)
    extended = b"RIFF\0\0\0\0WEBPVP8X\x0a\0\0\0" + bytes(4) + bytes((29, 0, 0, 19, 0, 0))
    assert claim_of(extended) == ImageClaim(ImageFormat.WEBP, 20, 30)
    assert claim_of(b"BM" + bytes(12) + struct.pack("<IHH", 12, 30, 20)) == ImageClaim(ImageFormat.BMP, 20, 30)
    assert claim_of(b"BM" + bytes(12) + struct.pack("<Iii", 40, 30, -20)) == ImageClaim(ImageFormat.BMP, 20, 30)
    assert claim_of(b"P5 # a map\n# of a room\n30 20\n255\n") == ImageClaim(ImageFormat.PNM, 20, 30)


@pytest.mark.parametrize(
    "data", [b"", b"GIF89a", b"RIFF\0\0\0\0WEBPxxxx" + bytes(20), b"P7\nWIDTH 3", b"II*\0\xff\xff\xff\xff"]
)
def test_other_bytes_claim_nothing(data: bytes) -> None:
    assert claim_of(data) is None


def test_progressive_jpeg_may_have_some_scans_but_not_thousands() -> None:
    data = _file(".jpg", cv2.IMWRITE_JPEG_PROGRESSIVE, 1)
    assert claim_of(data) == ImageClaim(ImageFormat.JPEG, 20, 30)
    frame = data.index(b"\xff\xc2") + 5
    wide = data[:frame] + struct.pack(">HH", 5000, 5000) + data[frame + 4 :]
    assert claim_of(wide) == ImageClaim(ImageFormat.JPEG, 5000, 5000)
    scan = data[data.rindex(b"\xff\xda") : -2]
    assert claim_of(wide[:-2] + 100 * scan + wide[-2:]) is None
    huge = data[:frame] + struct.pack(">HH", 20_000, 20_000) + data[frame + 4 :]
    assert claim_of(huge) is None


@pytest.mark.parametrize(("tag", "value"), [(322, 1 << 24), (258, 64), (277, 60_000)])
def test_tiff_of_huge_tiles_or_samples_claims_nothing(tag: int, value: int) -> None:
    entries = {256: 20_000, 257: 5000, 258: 8, 277: 1, tag: value}
    rows = b"".join(struct.pack("<HHII", key, 4, 1, number) for key, number in sorted(entries.items()))
    head = b"II*\0" + struct.pack("<IH", 8, len(entries))
    assert claim_of(head + rows) is None
    entries |= {322: 256, 258: 8, 277: 1}
    rows = b"".join(struct.pack("<HHII", key, 4, 1, number) for key, number in sorted(entries.items()))
    head = b"II*\0" + struct.pack("<IH", 8, len(entries))
    assert claim_of(head + rows) == ImageClaim(ImageFormat.TIFF, 5000, 20_000)


def test_png_keeps_what_makes_its_pixels() -> None:
    data = _file(".png")
    assert plain_png(data) is data
    for kind, kept in ((b"tEXt", False), (b"acTL", False), (b"abCd", False), (b"gAMA", True), (b"eXIf", True)):
        chunk = struct.pack(">I", 4) + kind + bytes(8)
        longer = data[:33] + chunk + data[33:]
        assert plain_png(longer) == (longer if kept else data)
        assert plain_png(longer + b"behind the end") == (longer + b"behind the end" if kept else data)
    assert plain_png(data[:-1]) is None
    assert plain_png(data[:33] + b"\0\0\0\0IDAT\0\0\0\0" * 70_000) is None
