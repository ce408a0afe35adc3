"""Encoded images that somebody else has written: what they claim to be, before anything is decoded."""

import struct
from typing import Any

import numpy as np
import numpy.typing as npt

PIXELS_MAX = 2**25
"""An image of more pixels is none of ours: a few bytes can claim a thousand million."""
_PNG = b"\x89PNG\r\n\x1a\n"
_JPEG = b"\xff\xd8"
_FRAMES = frozenset(range(0xC0, 0xD0)) - {0xC4, 0xC8, 0xCC}
"""JPEG's markers before the size of the image."""
_BARE = frozenset((0x01, *range(0xD0, 0xD9)))
"""JPEG's markers that stand alone."""


def encoded_size_px(data: bytes | memoryview) -> tuple[int, int] | None:
    """Height and width that a JPEG or PNG file claims; None if it is neither, or says nothing.

    Source: ISO/IEC 10918-1, annex B; PNG specification, third edition, section 11.2.1.
    """
    head = bytes(data[:24])
    if head[:8] == _PNG:
        return struct.unpack(">II", head[16:24])[::-1] if len(head) == 24 else None
    return _jpeg_size_px(data) if head[:2] == _JPEG else None


def _jpeg_size_px(data: bytes | memoryview) -> tuple[int, int] | None:
    offset = 2
    while offset + 9 <= len(data) and data[offset] == 0xFF:
        marker = data[offset + 1]
        if marker in _FRAMES:
            height_px, width_px = struct.unpack_from(">HH", data, offset + 5)
            return height_px, width_px
        # A marker may be preceded by any number of fill bytes.
        bare = marker in _BARE or marker == 0xFF
        step = 1 if marker == 0xFF else 2
        offset += step if bare else 2 + int.from_bytes(data[offset + 2 : offset + 4], "big")
    return None


def decode_pixels(data: bytes | memoryview, flags: int) -> npt.NDArray[Any] | None:
    """Pixels of a JPEG or PNG file as OpenCV gives them; None if it is neither, damaged, or claims too many.

    Args:
        data: The file.
        flags: OpenCV's `IMREAD_...`.
    """
    import cv2

    size_px = encoded_size_px(data)
    if size_px is None or not 0 < size_px[0] * size_px[1] <= PIXELS_MAX:
        return None
    try:
        return cv2.imdecode(np.frombuffer(data, dtype=np.uint8), flags)
    except cv2.error:
        return None


def decode_image(data: bytes) -> npt.NDArray[np.uint8] | None:
    """An encoded image as sRGB, shape (H, W, 3); None if it cannot be decoded."""
    import cv2

    bgr = decode_pixels(data, cv2.IMREAD_COLOR)
    if bgr is None:
        return None
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)
