"""Decoding images from other programs: their stated format and size are checked before any memory is used."""

from collections.abc import Collection
from pathlib import Path

import numpy as np

from readygo.common.arrays import AnyArray, UInt8Array
from readygo.common.files import read_regular
from readygo.common.images.claims import ImageFormat, claim_of, plain_png

PIXELS_MAX = 2**25
"""An image of more pixels is none of ours."""
PHOTO_PIXELS_MAX = 2**27
"""A photo of more pixels is not read: turned upright it takes 0.8 GB."""
_FILE_BYTES_MAX = 2**29
RECORDED = (ImageFormat.JPEG, ImageFormat.PNG)
"""What robots send and shards hold."""
PICTURES = tuple(ImageFormat)
"""What photos, maps and textures may be."""


def encoded_size_px(data: bytes | memoryview) -> tuple[int, int] | None:
    """Height and width that an encoded image claims; None if it is of no known format or says nothing."""
    claim = claim_of(data)
    return None if claim is None else (claim.height_px, claim.width_px)


def decode_pixels(
    data: bytes | memoryview,
    flags: int,
    *,
    formats: Collection[ImageFormat] = RECORDED,
    pixels_max: int = PIXELS_MAX,
) -> AnyArray | None:
    """Pixels of an encoded image as OpenCV gives them; None if it is of no such format, damaged, or claims too many.

    Args:
        data: The file.
        flags: OpenCV's `IMREAD_...`.
        formats: What it may be.
        pixels_max: An image of more pixels is not decoded.
    """
    import cv2

    claim = claim_of(data)
    if claim is None or claim.format not in formats or not 0 < claim.height_px * claim.width_px <= pixels_max:
        return None
    image = plain_png(data) if claim.format is ImageFormat.PNG else data
    if image is None:
        return None
    try:
        return cv2.imdecode(np.frombuffer(image, dtype=np.uint8), flags)
    except (cv2.error, MemoryError):
        return None


def read_pixels(path: Path, flags: int) -> AnyArray | None:
    """Pixels of a photo as OpenCV gives them; None if there is no such file, or it is none that can be decoded."""
    try:
        data = read_regular(path, bytes_max=_FILE_BYTES_MAX)
    except OSError:
        return None
    return decode_pixels(data, flags, formats=PICTURES, pixels_max=PHOTO_PIXELS_MAX)


def decode_image(data: bytes) -> UInt8Array | None:
    """An encoded image as sRGB, shape (H, W, 3); None if it cannot be decoded."""
    import cv2

    bgr = decode_pixels(data, cv2.IMREAD_COLOR)
    if bgr is None:
        return None
    return np.asarray(cv2.cvtColor(bgr, cv2.COLOR_BGR2RGB), dtype=np.uint8)
