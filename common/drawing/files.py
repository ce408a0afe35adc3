"""Pictures as bytes and files."""

from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.files import write_whole

Picture = npt.NDArray[np.uint8]
JPEG_QUALITY = 90


def png_bytes(rgb: Picture) -> bytes:
    """A picture (H, W, 3) as PNG."""
    return _encode_image(rgb, ".png", [cv2.IMWRITE_PNG_COMPRESSION, 9])


def jpeg_bytes(rgb: Picture) -> bytes:
    """A picture (H, W, 3) as JPEG."""
    return _encode_image(rgb, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def write_png(path: Path, rgb: Picture) -> None:
    """Write a picture (H, W, 3) as PNG; folders on the way are made.

    Raises:
        ReadygoError: If it cannot be written.
    """
    write_whole(path, png_bytes(rgb))


def _encode_image(rgb: Picture, ending: str, options: list[int]) -> bytes:
    done, data = cv2.imencode(ending, np.ascontiguousarray(rgb[:, :, ::-1]), options)
    assert done
    return bytes(data.tobytes())
