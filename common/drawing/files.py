"""Pictures as bytes and files."""

from pathlib import Path

import cv2
import numpy as np

from readygo.common.arrays import Float32Array, UInt8Array
from readygo.common.files import write_whole

JPEG_QUALITY = 90


def quantise(planes: Float32Array) -> UInt8Array:
    """Colours (3, H, W) in 0..1 as a picture (H, W, 3)."""
    return np.ascontiguousarray((np.clip(planes, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8).transpose(1, 2, 0))


def png_bytes(rgb: UInt8Array) -> bytes:
    """A picture (H, W, 3) as PNG."""
    return _encode_image(rgb, ".png", [cv2.IMWRITE_PNG_COMPRESSION, 9])


def jpeg_bytes(rgb: UInt8Array) -> bytes:
    """A picture (H, W, 3) as JPEG."""
    return _encode_image(rgb, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def write_png(path: Path, rgb: UInt8Array) -> None:
    """Write a picture (H, W, 3) as PNG; folders on the way are made.

    Raises:
        ReadygoError: If it cannot be written.
    """
    write_whole(path, png_bytes(rgb))


def _encode_image(rgb: UInt8Array, ending: str, options: list[int]) -> bytes:
    done, data = cv2.imencode(ending, np.ascontiguousarray(rgb[:, :, ::-1]), options)
    assert done
    return bytes(data.tobytes())
