"""Images as cameras of ROS robots send them."""

from typing import Any

import cv2
import numpy as np
import numpy.typing as npt

_BGR: dict[str, tuple[int, int | None]] = {
    "bgr8": (3, None),
    "8UC3": (3, None),
    "rgb8": (3, cv2.COLOR_RGB2BGR),
    "mono8": (1, cv2.COLOR_GRAY2BGR),
    "8UC1": (1, cv2.COLOR_GRAY2BGR),
    "rgba8": (4, cv2.COLOR_RGBA2BGR),
    "bgra8": (4, cv2.COLOR_BGRA2BGR),
    "yuv422": (2, cv2.COLOR_YUV2BGR_UYVY),
    "uyvy": (2, cv2.COLOR_YUV2BGR_UYVY),
    "yuv422_yuy2": (2, cv2.COLOR_YUV2BGR_YUY2),
    "yuyv": (2, cv2.COLOR_YUV2BGR_YUY2),
    "bayer_rggb8": (1, cv2.COLOR_BayerRGGB2BGR),
    "bayer_bggr8": (1, cv2.COLOR_BayerBGGR2BGR),
    "bayer_gbrg8": (1, cv2.COLOR_BayerGBRG2BGR),
    "bayer_grbg8": (1, cv2.COLOR_BayerGRBG2BGR),
}
"""Bytes per pixel, and OpenCV's conversion to BGR."""
ENCODINGS = tuple(_BGR)
"""Encodings of raw images that can be read."""


def bgr_of(data: npt.ArrayLike, *, encoding: str, height_px: int, width_px: int, row_bytes: int) -> npt.NDArray[Any]:
    """Pixels of a raw image.

    Args:
        data: Its bytes, row by row.
        encoding: Name that ROS has for what they mean.
        height_px: Rows.
        width_px: Pixels of a row.
        row_bytes: Bytes of a row.

    Returns:
        Blue, green, red, shape (H, W, 3), uint8.

    Raises:
        ValueError: If the encoding is not known, or the sizes do not fit the data.
    """
    if encoding not in _BGR:
        raise ValueError(f"images of encoding {encoding!r}; known: {', '.join(ENCODINGS)}")
    channels, conversion = _BGR[encoding]
    flat = np.asarray(data, dtype=np.uint8).reshape(-1)
    if row_bytes < width_px * channels or len(flat) != height_px * row_bytes or flat.size == 0:
        raise ValueError(f"an image of {height_px}x{width_px} px {encoding} in {len(flat)} bytes of {row_bytes} a row")
    rows = flat.reshape(height_px, row_bytes)[:, : width_px * channels]
    if conversion is None:
        return rows.reshape(height_px, width_px, channels)
    shape = (height_px, width_px) if channels == 1 else (height_px, width_px, channels)
    return cv2.cvtColor(np.ascontiguousarray(rows).reshape(shape), conversion)
