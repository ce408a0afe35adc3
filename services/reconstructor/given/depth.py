"""Depth images that devices measure beside their images: which there are, and their values in metres.

.png   16 bits, in millimetres
.exr   one channel of floats, in metres; read by OpenEXR
.depth floats in metres, row by row, compressed with LZFSE; read by liblzfse

A depth is along the optical axis. Values that are 0 or not finite are unmeasured, and those of low confidence (0; ARKit
has low, medium and high) as well. Depth images show what their image shows, with fewer pixels.

Source: PolyCam/polyform, README, "depth" and "confidence"; nerfstudio's documentation, "Data conventions"; Record3D,
issues 7, 67 and 81 of marek-simonik/record3d.
"""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from readygo.common.arrays import AnyArray, Float32Array
from readygo.common.errors import SceneError
from readygo.common.extras import install_command, is_installed
from readygo.common.files import read_regular, write_whole
from readygo.common.images.encoded import PIXELS_MAX, read_pixels
from readygo.services.reconstructor.frames.depths import STEP_M, to_steps
from readygo.services.reconstructor.frames.video import is_same_shape

LIDAR_FAR_M = 5.0
"""What ARKit tells from farther away than the LiDAR sensor of a phone reaches is a guess."""
_SIDE_MAX_PX = 256
"""Finer depth images are thinned: longer side."""
_MEDIAN_MIN_M, _MEDIAN_MAX_M = 0.02, 100.0
"""A place whose median depth is out of these bounds was written in another unit."""
_BYTES_MAX = 1 << 26
_MODULES = {".exr": "OpenEXR", ".depth": "liblzfse"}
_LEAVE_OUT = "--frames.depth false leaves depth images out"


@dataclass(frozen=True, kw_only=True)
class DepthFile:
    """The depth image of a frame."""

    path: Path
    confidence: Path | None = None
    """Image of the confidence, of the same size; None if there is none: all depths count."""
    far_m: float = math.inf
    """Depths beyond this are not measured [m]."""

    @property
    def files(self) -> list[Path]:
        """All files of it."""
        return [self.path] if self.confidence is None else [self.path, self.confidence]


def find_depth(path: Path, confidence: Path | None = None, *, far_m: float = math.inf) -> DepthFile | None:
    """The depth image of a frame, with its confidence where there is one; None if there is no such file."""
    if not path.is_file():
        return None
    return DepthFile(path=path, confidence=confidence if confidence and confidence.is_file() else None, far_m=far_m)


def absent_modules(depths: Iterable[DepthFile | None]) -> list[str]:
    """Modules that reading depth images needs, and that are not installed."""
    needed = {_MODULES.get(depth.path.suffix.lower(), "") for depth in depths if depth is not None}
    return sorted(module for module in needed if module and not is_installed(module))


def write_depths(
    depths: Mapping[str, DepthFile | None], sizes_px: Mapping[str, tuple[int, int]], folder: Path
) -> tuple[int, list[str]]:
    """Write the depth images of some images as `folder`/NAME.png, 16 bits, in millimetres, 0 where unmeasured.

    Args:
        depths: Of the images, by name.
        sizes_px: Width and height of the images.
        folder: Where to write.

    Returns:
        How many there are; notes on those that are not used.

    Raises:
        SceneError: If one has another shape than its image, or impossible depths.
    """
    given = {name: depth for name, depth in depths.items() if depth is not None}
    absent = absent_modules(given.values())
    if absent:
        return 0, [f"depth images are not used: reading them needs {absent[0]}; run: {install_command('record3d')}"]
    used = 0
    for name, depth in given.items():
        depth_m = read_depth(depth, sizes_px[name])
        if depth_m is None:
            continue
        used += 1
        data = cv2.imencode(".png", to_steps(depth_m))[1].tobytes()
        write_whole(folder / f"{name}.png", data, raises=SceneError)
    lost = len(depths) - used if given else 0
    return used, [f"depth images of {lost} of {len(depths)} images are missing, broken or empty"] if lost else []


def read_depth(file: DepthFile, size_px: tuple[int, int]) -> Float32Array | None:
    """Depths of a frame, 0 where they are not measured, shape (H, W) [m]; the longer side has 256 pixels at most.

    Args:
        file: What to read.
        size_px: Width and height of the frame's image.

    Returns:
        None if the file is broken, or holds no measured depth.

    Raises:
        SceneError: If it has another shape than the image, or impossible depths.
    """
    depth_m = _READERS.get(file.path.suffix.lower(), _of_png)(file.path, size_px)
    if depth_m is None:
        return None
    rows, columns = depth_m.shape
    if not is_same_shape((columns, rows), size_px):
        raise SceneError(
            f"{file.path} is {columns}x{rows} px, its image {size_px[0]}x{size_px[1]} px: depth images must show what "
            f"their images show; {_LEAVE_OUT}."
        )
    measured = np.isfinite(depth_m) & (depth_m > 0)
    if file.confidence is not None:
        measured &= _confidence(file.confidence, (rows, columns)) > 0
    if not measured.any():
        return None
    _check_unit(file.path, float(np.median(depth_m[measured])))
    kept = np.where(measured & (depth_m <= file.far_m), depth_m, 0).astype(np.float32)
    share = min(1.0, _SIDE_MAX_PX / max(rows, columns))
    # Means of depths would lie between things.
    size = (round(columns * share), round(rows * share))
    return np.asarray(cv2.resize(kept, size, interpolation=cv2.INTER_NEAREST_EXACT), dtype=np.float32)


def _check_unit(path: Path, median_m: float) -> None:
    if median_m > _MEDIAN_MAX_M:
        cause = f"these look like millimetres instead of metres; {_LEAVE_OUT}"
    elif median_m < _MEDIAN_MIN_M:
        cause = f"these look like metres instead of millimetres; {_LEAVE_OUT}"
    else:
        return
    raise SceneError(f"{path} has a median depth of {median_m:.4g} m: {cause}.")


def _of_png(path: Path, _size_px: tuple[int, int]) -> Float32Array | None:
    pixels = read_pixels(path, cv2.IMREAD_UNCHANGED)
    if pixels is None:
        return None
    if pixels.dtype != np.uint16 or pixels.ndim != 2:
        raise SceneError(
            f"{path} has {8 * pixels.dtype.itemsize} bits and {pixels.shape[2] if pixels.ndim > 2 else 1} channels: "
            f"depth images have one channel of 16 bits, in millimetres; {_LEAVE_OUT}."
        )
    return np.asarray(pixels * np.float32(STEP_M))


def _of_exr(path: Path, _size_px: tuple[int, int]) -> Float32Array | None:
    import OpenEXR

    try:
        with OpenEXR.File(str(path), header_only=True) as head:
            low, high = head.header()["dataWindow"]
        if not 0 < (int(high[0]) - int(low[0]) + 1) * (int(high[1]) - int(low[1]) + 1) <= PIXELS_MAX:
            return None
        with OpenEXR.File(str(path), separate_channels=True) as file:
            channel = next(iter(file.channels().values())).pixels
        return np.asarray(channel, dtype=np.float32)
    except (RuntimeError, ValueError, TypeError, KeyError, StopIteration):
        return None


def _of_lzfse(path: Path, size_px: tuple[int, int]) -> Float32Array | None:
    values = _decompress(path)
    if values is None or len(values) % 4 or not values:
        return None
    depth_m = np.frombuffer(values, dtype=np.float32)
    # Metadata of older exports does not tell the sides (dw, dh): they are in proportion to those of the image.
    rows = max(1, round(math.sqrt(len(depth_m) * size_px[1] / size_px[0])))
    if len(depth_m) % rows:
        raise SceneError(f"{path} has {len(depth_m)} depths, which make no image as {size_px[0]}x{size_px[1]} px do.")
    return depth_m.reshape(rows, -1)


_READERS = {".exr": _of_exr, ".depth": _of_lzfse}


def _confidence(path: Path, shape: tuple[int, int]) -> AnyArray:
    """Confidences, in the unit of the file, of so many rows and columns."""
    if path.suffix == ".conf":
        values = _decompress(path)
        pixels = None if values is None else np.frombuffer(values, dtype=np.uint8)
        pixels = pixels.reshape(shape) if pixels is not None and pixels.size == shape[0] * shape[1] else None
    else:
        pixels = read_pixels(path, cv2.IMREAD_UNCHANGED)
    if pixels is None or pixels.shape != shape:
        raise SceneError(f"{path} is no image of {shape[1]}x{shape[0]} confidences, as its depth image needs.")
    return pixels


def _decompress(path: Path) -> bytes | None:
    import liblzfse

    try:
        return bytes(liblzfse.decompress(read_regular(path, bytes_max=_BYTES_MAX)))
    except (OSError, ValueError, RuntimeError, liblzfse.error):
        return None
