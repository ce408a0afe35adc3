"""Decoding of images of ROS robots' cameras."""

import struct

import cv2
import numpy as np
import numpy.typing as npt

from readygo.common.arrays import AnyArray, Float32Array, UInt16Array
from readygo.common.images.encoded import decode_pixels

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
"""Bytes per pixel and OpenCV's conversion to BGR, by encoding."""
ENCODINGS = tuple(_BGR)
"""Supported encodings of raw images."""


DEPTHS: dict[str, tuple[type[np.generic], float]] = {"16UC1": (np.uint16, 1000.0), "32FC1": (np.float32, 1.0)}
"""Encodings of depth images: type of a pixel, and units in a metre (REP 118)."""
_DEPTH_HEADER = struct.Struct("<iff")
"""Header of compressed depths: kind of compression, then the two parameters of the quantised inverse depths."""


def depth_of(
    data: npt.ArrayLike, *, encoding: str, height_px: int, width_px: int, row_bytes: int, big_endian: bool = False
) -> Float32Array:
    """Depths of a raw image.

    Args:
        data: Its bytes, row by row.
        encoding: One of `DEPTHS`.
        height_px: Rows.
        width_px: Pixels of a row.
        row_bytes: Bytes of a row.
        big_endian: True if the first byte of a number is the most significant one.

    Returns:
        Depths [m], inf where nothing was measured, shape (H, W).

    Raises:
        ValueError: If it is no depth image, or the sizes do not fit the data.
    """
    if encoding not in DEPTHS:
        raise ValueError(f"depths of encoding {encoding!r}; known: {', '.join(DEPTHS)}")
    kind, per_metre = DEPTHS[encoding]
    dtype = np.dtype(kind).newbyteorder(">" if big_endian else "<")
    flat = np.asarray(data, dtype=np.uint8).reshape(-1)
    if row_bytes < width_px * dtype.itemsize or len(flat) != height_px * row_bytes or flat.size == 0:
        raise ValueError(f"depths of {height_px}x{width_px} px {encoding} in {len(flat)} bytes of {row_bytes} a row")
    rows = np.ascontiguousarray(flat.reshape(height_px, row_bytes)[:, : width_px * dtype.itemsize])
    depth_m = rows.view(dtype).astype(np.float32) / np.float32(per_metre)
    return np.where(depth_m > 0, depth_m, np.float32(np.inf))


def pixels_of(
    data: npt.ArrayLike, *, encoding: str, height_px: int, width_px: int, row_bytes: int, big_endian: bool = False
) -> AnyArray:
    """Depths [m] or BGR pixels of a raw image, by its encoding; arguments as in `depth_of`."""
    size = {"height_px": height_px, "width_px": width_px, "row_bytes": row_bytes}
    if encoding in DEPTHS:
        return depth_of(data, encoding=encoding, big_endian=big_endian, **size)
    return bgr_of(data, encoding=encoding, **size)


def compressed_depth_of(data: bytes, image_format: str) -> Float32Array:
    """Depths of a compressed image of ROS's compressedDepth, see `compressed_depth`.

    Args:
        data: A header of 12 bytes, and a PNG.
        image_format: Format field of the message, such as "16UC1; compressedDepth png".

    Returns:
        Depths [m], inf where nothing was measured, shape (H, W).

    Raises:
        ValueError: If the data are not of this format, or not compressed as PNG.

    Source: ros-perception/image_transport_plugins, compressed_depth_image_transport (codec.cpp).
    """
    encoding, _, how = image_format.partition(";")
    if encoding.strip() not in DEPTHS or not is_compressed_depth(image_format) or "rvl" in how:
        raise ValueError(f"compressed depths of format {image_format!r}; known: 16UC1 or 32FC1; compressedDepth png")
    pixels = decode_pixels(data[_DEPTH_HEADER.size :], cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise ValueError(f"compressed depths that are no PNG of 16 bits (format {image_format!r})")
    stored, nothing = pixels.astype(np.float32), np.float32(np.inf)
    if encoding.strip() == "16UC1":
        return np.where(pixels > 0, stored / np.float32(1000.0), nothing)
    _, factor, offset = _DEPTH_HEADER.unpack_from(data)
    with np.errstate(divide="ignore", invalid="ignore"):
        depth_m = np.float32(factor) / (stored - np.float32(offset))
    return np.where((pixels > 0) & (depth_m > 0), depth_m, nothing).astype(np.float32)


def is_compressed_depth(image_format: str) -> bool:
    """True if the format field of a compressed image names compressedDepth."""
    return "compressedDepth" in image_format


def compressed_depth(depth_m: Float32Array) -> tuple[bytes, str]:
    """Encode depths [m] as ROS's compressedDepth of 16UC1; returns the bytes and the format field.

    The header's quantisation of inverse depths is unused: 16UC1 has plain millimetres.
    """
    done, png = cv2.imencode(".png", millimetres(depth_m))
    assert done
    return _DEPTH_HEADER.pack(0, 0.0, 0.0) + png.tobytes(), "16UC1; compressedDepth png"


def millimetres(depth_m: Float32Array) -> UInt16Array:
    """Depths [m] as 16UC1: millimetres, 0 where nothing was measured."""
    with np.errstate(invalid="ignore"):
        rounded = np.rint(depth_m * np.float32(1000.0))
    return np.where((rounded > 0) & (rounded < 2**16), rounded, 0).astype(np.uint16)


def bgr_of(data: npt.ArrayLike, *, encoding: str, height_px: int, width_px: int, row_bytes: int) -> AnyArray:
    """Pixels of a raw image.

    Args:
        data: Its bytes, row by row.
        encoding: ROS's name of the encoding.
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
    try:
        return cv2.cvtColor(np.ascontiguousarray(rows).reshape(shape), conversion)
    except cv2.error as error:
        raise ValueError(f"an image of {height_px}x{width_px} px, a size that {encoding} cannot have") from error
