"""What an encoded image claims to be, read from its headers before anything is decoded.

A few bytes can claim a thousand million pixels, and decoders allocate what is claimed. They allocate a PNG's chunk
before its bytes have come, unpack its compressed texts, and go through all pixels of a JPEG for each of its scans.

Source: PNG specification, third edition; ISO/IEC 10918-1, annex B (JPEG); TIFF 6.0; WebP container specification;
Netpbm's pbm(5), pgm(5) and ppm(5).
"""

import enum
import re
import struct
from typing import NamedTuple

CHUNKS_MAX = 2**16
"""Chunks of a PNG; encoders put 8 kB or more into each."""
BUFFERED_PIXELS_MAX = 2**26
"""A JPEG of several scans is kept in memory with 6 bytes for a pixel, besides the pixels."""
SCANNED_PIXELS_MAX = 2**31
"""Pixels of a JPEG times its scans; those of a progressive one are 10 as a rule."""
_TIFF_BYTES_MAX = 2**29
_TILE_MAX_PX = 4096

_PNG = b"\x89PNG\r\n\x1a\n"
_KEPT_CHUNKS = frozenset((b"tRNS", b"eXIf", b"gAMA", b"cHRM", b"sRGB", b"iCCP", b"cICP"))
"""Ancillary chunks that are kept: transparency, orientation, and how colours are coded."""
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG's markers before the size of the image."""
_BARE = frozenset((0x01, *range(0xD0, 0xD9)))
"""JPEG's markers that stand alone."""
_SCAN = 0xDA
_PNM = re.compile(rb"P[1-6](?:\s|#[^\n]*\n)+(\d{1,9})(?:\s|#[^\n]*\n)+(\d{1,9})\s")
_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS, _TIFF_SAMPLES, _TIFF_TILES = 256, 257, 258, 277, (322, 323)
_TIFF_TYPES = {1: "B", 3: "H", 4: "I"}


class ImageFormat(enum.Enum):
    """Formats whose headers are known."""

    PNG = "PNG"
    JPEG = "JPEG"
    BMP = "BMP"
    PNM = "PNM"
    TIFF = "TIFF"
    WEBP = "WebP"


class ImageClaim(NamedTuple):
    """What an encoded image says of itself."""

    format: ImageFormat
    height_px: int
    width_px: int


def claim_of(data: bytes | memoryview) -> ImageClaim | None:
    """Format and size of an image; None if it is of no known format, cut off, or would cost more than its pixels."""
    head = bytes(data[:512])
    try:
        if head[:8] == _PNG:
            return _png(data)
        if head[:2] == b"\xff\xd8":
            return _jpeg(data)
        if head[:2] == b"BM":
            return _bmp(head)
        if head[:4] == b"RIFF" and head[8:12] == b"WEBP":
            return _webp(head)
        if head[:4] in (b"II*\0", b"MM\0*"):
            return _tiff(data, "<" if head[:1] == b"I" else ">")
        if found := _PNM.match(head):
            return ImageClaim(ImageFormat.PNM, int(found[2]), int(found[1]))
    except (struct.error, IndexError):
        return None
    return None


def plain_png(data: bytes | memoryview) -> bytes | memoryview | None:
    """A PNG file without texts and other chunks that change no pixel; None if a chunk ends behind the file.

    Returns:
        The file itself where there is nothing to leave out.
    """
    kept, begin, offset = [data[:8]], 8, 8
    for _ in range(CHUNKS_MAX):
        if offset == len(data):
            break
        end = offset + 12 + int.from_bytes(data[offset : offset + 4], "big")
        kind = bytes(data[offset + 4 : offset + 8])
        if end > len(data):
            return None
        # The first letter of an ancillary chunk is a small one.
        if kind[:1].islower() and kind not in _KEPT_CHUNKS:
            kept.append(data[begin:offset])
            begin = end
        offset = end
        if kind == b"IEND":
            break
    else:
        return None
    return data if begin == 8 else b"".join([*kept, data[begin:offset]])


def _png(data: bytes | memoryview) -> ImageClaim:
    width_px, height_px = struct.unpack_from(">II", data, 16)
    return ImageClaim(ImageFormat.PNG, height_px, width_px)


def _jpeg(data: bytes | memoryview) -> ImageClaim | None:
    offset, frame, claim = 2, 0, None
    while offset + 9 <= len(data) and data[offset] == 0xFF:
        marker = data[offset + 1]
        if marker in _FRAMES:
            frame, components = marker, data[offset + 9]
            height_px, width_px = struct.unpack_from(">HH", data, offset + 5)
            claim = ImageClaim(ImageFormat.JPEG, height_px, width_px)
        if marker == _SCAN:
            if claim is None:
                return None
            is_single = frame in (0xC0, 0xC1) and data[offset + 4] == components
            return claim if is_single or _is_scanned_fast(data, offset, height_px * width_px) else None
        # A marker may be preceded by any number of fill bytes.
        bare = marker in _BARE or marker == 0xFF
        step = 1 if marker == 0xFF else 2
        offset += step if bare else 2 + int.from_bytes(data[offset + 2 : offset + 4], "big")
    return None


def _is_scanned_fast(data: bytes | memoryview, begin: int, pixels: int) -> bool:
    """True if the scans of a JPEG do not cost more than they may; coded data hold no marker."""
    scans = bytes(data[begin:]).count(bytes((0xFF, _SCAN)))
    return pixels <= BUFFERED_PIXELS_MAX and scans * pixels <= SCANNED_PIXELS_MAX


def _bmp(head: bytes) -> ImageClaim:
    if int.from_bytes(head[14:18], "little") < 40:
        width_px, height_px = struct.unpack_from("<HH", head, 18)
    else:
        width_px, height_px = struct.unpack_from("<ii", head, 18)
    return ImageClaim(ImageFormat.BMP, abs(height_px), abs(width_px))


def _webp(head: bytes) -> ImageClaim | None:
    kind = head[12:16]
    if kind == b"VP8X":
        sides = struct.unpack_from("3s3s", head, 24)
        width_px, height_px = (1 + int.from_bytes(side, "little") for side in sides)
    elif kind == b"VP8L":
        (bits,) = struct.unpack_from("<I", head, 21)
        width_px, height_px = 1 + (bits & 0x3FFF), 1 + (bits >> 14 & 0x3FFF)
    elif kind == b"VP8 ":
        width_px, height_px = (side & 0x3FFF for side in struct.unpack_from("<HH", head, 26))
    else:
        return None
    return ImageClaim(ImageFormat.WEBP, height_px, width_px)


def _tiff(data: bytes | memoryview, order: str) -> ImageClaim | None:
    """Claim of the first image of a TIFF file; a decoder that is asked for one image reads that."""
    (at,) = struct.unpack_from(f"{order}I", data, 4)
    (count,) = struct.unpack_from(f"{order}H", data, at)
    values = {_TIFF_BITS: 1, _TIFF_SAMPLES: 1}
    for entry in range(at + 2, at + 2 + 12 * count, 12):
        tag, kind, number = struct.unpack_from(f"{order}HHI", data, entry)
        if kind in _TIFF_TYPES and tag in (_TIFF_WIDTH, _TIFF_HEIGHT, _TIFF_BITS, _TIFF_SAMPLES, *_TIFF_TILES):
            # Numbers that have no room in the entry are bits of several samples: alike, in files that are read.
            kind_of_value = f"{order}{_TIFF_TYPES[kind]}"
            fits = number * struct.calcsize(kind_of_value) <= 4
            place = entry + 8 if fits else struct.unpack_from(f"{order}I", data, entry + 8)[0]
            (values[tag],) = struct.unpack_from(kind_of_value, data, place)
    height_px, width_px = values.get(_TIFF_HEIGHT, 0), values.get(_TIFF_WIDTH, 0)
    size_bytes = height_px * width_px * values[_TIFF_BITS] * values[_TIFF_SAMPLES] // 8
    if size_bytes > _TIFF_BYTES_MAX or any(values.get(tag, 0) > _TILE_MAX_PX for tag in _TIFF_TILES):
        return None
    return ImageClaim(ImageFormat.TIFF, height_px, width_px)
