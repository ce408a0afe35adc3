"""The images of a view besides rgb as files, and back: what is recorded of them.

| output | file | a pixel |
|---|---|---|
| depth, median_depth | PNG, 16 bit grey | millimetres; 0 where there is nothing, and beyond 65.535 m |
| alpha | PNG, 8 bit grey | 255 times alpha |
| mask | PNG, 8 bit grey | as it is |
| normal | PNG, 8 bit RGB | 127.5 (n + 1); (128, 128, 128), which no vector of length 1 gives, where there is nothing |

All are rounded to the nearest: a depth is off by 0.5 mm at most, alpha by 0.002, a component of a normal by 0.006.
Millimetres in 16 bits are what depth cameras and their drivers store, so that other tools read the files as they are
(Rerun's EncodedDepthImage with `meter=0.001`, ROS's 16UC1). Viewers that decode PNG as a browser does show the upper 8
bits: a room is dark there, and the mask's small numbers are darker still.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, UInt8Array, UInt16Array
from readygo.common.images.encoded import decode_pixels
from readygo.common.images.images import FIELDS, Images

FILE_FORMAT = "png"

_MM_PER_M = np.float32(1000.0)
_MM_MAX = np.float32(65535.0)
_NO_NORMAL = 128


@dataclass(frozen=True)
class _Format:
    """How one output is stored."""

    dtype: Any
    channel_count: int
    flat: bool
    """True if most pixels equal their neighbours, False if they only resemble them."""
    to_pixels: Callable[[AnyArray], AnyArray]
    from_pixels: Callable[[AnyArray], AnyArray]


def _millimetres(depth_m: Float32Array) -> UInt16Array:
    rounded = np.rint(depth_m * _MM_PER_M)
    return np.where((rounded > 0) & (rounded <= _MM_MAX), rounded, 0).astype(np.uint16)


def _metres(pixels: UInt16Array) -> Float32Array:
    return np.where(pixels == 0, np.float32(np.inf), pixels.astype(np.float32) / _MM_PER_M)


def _bytes_of_unit(alpha: Float32Array) -> UInt8Array:
    return np.asarray(np.rint(np.clip(alpha, 0.0, 1.0) * np.float32(255.0)), dtype=np.uint8)


def _unit_of_bytes(pixels: UInt8Array) -> Float32Array:
    return pixels.astype(np.float32) / np.float32(255.0)


def _bytes_of_normal(normal: Float32Array) -> UInt8Array:
    shifted = np.clip(normal, -1.0, 1.0) + np.float32(1.0)
    return np.asarray(np.rint(shifted * np.float32(127.5)), dtype=np.uint8)


def _normal_of_bytes(pixels: UInt8Array) -> Float32Array:
    nothing = (pixels == _NO_NORMAL).all(axis=2, keepdims=True)
    normal = np.where(nothing, np.float32(0.0), pixels.astype(np.float32) / np.float32(127.5) - np.float32(1.0))
    length = np.sqrt((normal * normal).sum(axis=2, keepdims=True))
    return np.asarray(normal / np.where(nothing, np.float32(1.0), length), dtype=np.float32)


def _same(pixels: UInt8Array) -> UInt8Array:
    return pixels


_FORMATS: Mapping[str, _Format] = {
    "depth": _Format(np.uint16, 1, False, _millimetres, _metres),
    "median_depth": _Format(np.uint16, 1, False, _millimetres, _metres),
    "alpha": _Format(np.uint8, 1, True, _bytes_of_unit, _unit_of_bytes),
    "mask": _Format(np.uint8, 1, True, _same, _same),
    "normal": _Format(np.uint8, 3, False, _bytes_of_normal, _normal_of_bytes),
}


def encode_output(images: Images, name: str) -> bytes:
    """The file of an output.

    Args:
        images: The images of a view.
        name: One of `readygo.common.images.images.OUTPUTS` but "rgb", whose file is a matter of taste.

    Raises:
        ValueError: If the view has no such image.
    """
    form = _FORMATS[name]
    image = getattr(images, FIELDS[name])
    if image is None:
        raise ValueError(f"the view has no {name} image; ask for it when it is drawn.")
    pixels = form.to_pixels(image)
    return _encode_png(pixels[..., ::-1] if form.channel_count == 3 else pixels, form.flat)


def decode_output(name: str, data: bytes | memoryview) -> AnyArray | None:
    """The image in an output's file, None if it is damaged or another output's.

    Returns:
        As in `Images`: depths [m] float32 with inf where there is nothing, alpha float32, mask uint8, all of shape
        (H, W); normals float32, 0 where there is nothing, shape (H, W, 3).
    """
    import cv2

    form = _FORMATS[name]
    pixels = decode_pixels(data, cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.dtype != form.dtype or pixels.shape[2:] != ((3,) if form.channel_count == 3 else ()):
        return None
    return form.from_pixels(pixels[..., ::-1] if form.channel_count == 3 else pixels)


def _encode_png(pixels: AnyArray, flat: bool) -> bytes:
    """A PNG file; OpenCV's order of channels."""
    import cv2

    # Runs are all that is quick to find: in depths those of equal steps from the row above.
    parameters = [cv2.IMWRITE_PNG_COMPRESSION, 1, cv2.IMWRITE_PNG_STRATEGY, cv2.IMWRITE_PNG_STRATEGY_RLE]
    # OpenCV before 4.12 has no choice of filters.
    if hasattr(cv2, "IMWRITE_PNG_FILTER"):
        parameters += [cv2.IMWRITE_PNG_FILTER, cv2.IMWRITE_PNG_FILTER_NONE if flat else cv2.IMWRITE_PNG_FILTER_UP]
    done, encoded = cv2.imencode(".png", pixels, parameters)
    assert done
    return bytes(encoded)
