"""`transforms.json` of nerfstudio, instant-ngp and programs that write the same.

Cameras have OpenGL's axes. `applied_transform` (3x4) and `applied_scale` say what nerfstudio did to the frame of the
mapper or the device; both are undone. `depth_file_path` of a frame is a PNG of 16 bits in millimetres.

Source: nerfstudio's documentation, "Data conventions"; instant-ngp, "NeRF dataset tips".
"""

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.documents import read_json
from readygo.common.errors import SceneError
from readygo.common.frames import swap_opengl_axes
from readygo.common.images.encoded import read_pixels
from readygo.services.reconstructor.given.capture import GivenCapture, image_file, named_error
from readygo.services.reconstructor.given.depth import DepthFile, find_depth
from readygo.services.reconstructor.poses.intrinsics import Intrinsics, lens_of_row

FILE = "transforms.json"
_KIND = "a transforms.json"
_BYTES_MAX = 1 << 26
# Blender's files leave the ending out.
_ENDINGS = ("", ".png", ".jpg", ".jpeg", ".PNG", ".JPG")
_MODELS = ("", "OPENCV", "OPENCV_FISHEYE", "PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL")
_IGNORE_ORIENTATION = 1 | 128
"""`cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION`."""


def read_transforms(path: Path) -> GivenCapture:
    """Read a `transforms.json`; the scale of its poses is not known.

    Args:
        path: The file; paths of images in it are relative to its folder.

    Raises:
        SceneError: If it cannot be read, or a frame is incomplete or impossible.
    """
    try:
        table = read_json(path, bytes_max=_BYTES_MAX)
        if not isinstance(table, dict) or not isinstance(table.get("frames"), list):
            raise ValueError("it has no frames")
        frames = table["frames"]
        shared = {name: value for name, value in table.items() if name != "frames"}
        rows = [{**shared, **frame} for frame in frames]
        images = tuple(image_file(path.parent, str(row["file_path"]), _ENDINGS) for row in rows)
        T = np.array([_matrix(row["transform_matrix"]) for row in rows]).reshape(-1, 4, 4)
        return GivenCapture(
            kind="transforms.json",
            files=(path,),
            images=images,
            lenses=tuple(_lens(row, image) for row, image in zip(rows, images, strict=True)),
            T_world_camera=swap_opengl_axes(_undo(T, table)),
            metric=False,
            rough=False,
            depth=tuple(_depth(path.parent, row) for row in rows),
        )
    except (OSError, KeyError, TypeError, ValueError, OverflowError, AttributeError) as error:
        raise named_error(path, _KIND, error) from error


def _depth(folder: Path, row: Mapping[str, Any]) -> DepthFile | None:
    name = row.get("depth_file_path")
    return None if name is None else find_depth(folder / str(name))


def _matrix(value: Any) -> Float64Array:
    matrix = np.asarray(value, dtype=np.float64)
    if matrix.shape not in ((4, 4), (3, 4)):
        raise ValueError(f"a transform_matrix has the shape {matrix.shape}, not (4, 4)")
    return np.vstack([matrix[:3], [0.0, 0.0, 0.0, 1.0]])


def _undo(T: Float64Array, table: Mapping[str, Any]) -> Float64Array:
    """Poses in the frame that they came from."""
    if "applied_scale" in table:
        scale = float(table["applied_scale"])
        if not (math.isfinite(scale) and scale > 0.0):
            raise ValueError(f"applied_scale must be positive, got {scale:g}")
        T = T.copy()
        T[:, :3, 3] /= scale
    if "applied_transform" in table:
        try:
            T = np.linalg.inv(_matrix(table["applied_transform"])) @ T
        except np.linalg.LinAlgError as error:
            raise ValueError("applied_transform has no inverse") from error
    return T


def _lens(row: Mapping[str, Any], image: Path) -> Intrinsics:
    model = str(row.get("camera_model") or "").upper()
    if model not in _MODELS:
        raise ValueError(f"camera_model {model} is not known; OPENCV, OPENCV_FISHEYE and PINHOLE are")
    given = dict(row)
    size = None if "w" in row and "h" in row else _size_of(image)
    if "fl_x" not in row and "camera_angle_x" in row:
        width = float(row["w"]) if size is None else size[0]
        given["fl_x"] = 0.5 * width / math.tan(0.5 * float(row["camera_angle_x"]))
    if "fl_x" not in given:
        raise KeyError("fl_x or camera_angle_x")
    given.setdefault("fl_y", given["fl_x"])
    if model in ("PINHOLE", "SIMPLE_PINHOLE"):
        given = {name: value for name, value in given.items() if name not in ("k1", "k2", "k3", "k4", "p1", "p2")}
    return lens_of_row(given, size_px=size)


def _size_of(image: Path) -> tuple[int, int] | None:
    """Width and height of an image where the file does not tell them; None where it is missing."""
    try:
        pixels = read_pixels(image, _IGNORE_ORIENTATION)
    except (OSError, SceneError):
        return None
    return None if pixels is None else (pixels.shape[1], pixels.shape[0])
