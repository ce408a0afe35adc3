"""Exports of Record3D: `metadata` (JSON) with `rgb/N.jpg`.

`K` is the matrix of the intrinsics column by column, `w` and `h` the size; `perFrameIntrinsicCoeffs`, where it is
there, has fx, fy, cx, cy of each frame. `poses` has qx, qy, qz, qw, x, y, z of each frame in ARKit's world: metres, y
up, and camera axes of OpenGL. Depths are `depth/N.exr` beside `rgb/` (an export as EXR and JPG), or `rgbd/N.depth` with
`rgbd/N.conf` (an unpacked .r3d).

Source: Record3D's documentation of its .r3d format.
"""

from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.documents import read_json
from readygo.common.frames import swap_opengl_axes
from readygo.services.reconstructor.given.capture import GivenCapture, image_file, named_error, pose_matrices
from readygo.services.reconstructor.given.depth import LIDAR_FAR_M, DepthFile, find_depth
from readygo.services.reconstructor.poses.intrinsics import Intrinsics, lens

_KIND = "metadata of Record3D"
_FILES, _IMAGES = ("metadata", "metadata.json"), ("rgb", "rgbd", "EXR_RGBD/rgb")
_BYTES_MAX = 1 << 26


def find_record3d(folder: Path) -> tuple[Path, Path] | None:
    """The metadata and the folder of the images; None if there are none."""
    metadata = next((folder / name for name in _FILES if (folder / name).is_file()), None)
    images = next((folder / name for name in _IMAGES if (folder / name).is_dir()), None)
    return None if metadata is None or images is None else (metadata, images)


def read_record3d(metadata: Path, images: Path) -> GivenCapture:
    """Read the frames of an export.

    Args:
        metadata: The JSON file.
        images: Folder of the images, named by their numbers from 0.

    Raises:
        SceneError: If it cannot be read, or a pose is impossible.
    """
    try:
        row = read_json(metadata, bytes_max=_BYTES_MAX)
        poses = np.asarray(row["poses"], dtype=np.float64).reshape(-1, 7)
        return GivenCapture(
            kind="Record3D",
            files=(metadata,),
            images=tuple(image_file(images, str(number)) for number in range(len(poses))),
            lenses=_lenses(row, len(poses)),
            T_world_camera=swap_opengl_axes(pose_matrices(poses[:, :4], poses[:, 4:])),
            metric=True,
            rough=True,
            up=(0.0, 1.0, 0.0),
            depth=tuple(_depth(images, str(number)) for number in range(len(poses))),
        )
    except (OSError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise named_error(metadata, _KIND, error) from error


def _depth(images: Path, name: str) -> DepthFile | None:
    exr = find_depth(images.parent / "depth" / f"{name}.exr", far_m=LIDAR_FAR_M)
    return exr or find_depth(images / f"{name}.depth", images / f"{name}.conf", far_m=LIDAR_FAR_M)


def _lenses(row: dict[str, Any], count: int) -> tuple[Intrinsics, ...]:
    size = (int(row["w"]), int(row["h"]))
    each = row.get("perFrameIntrinsicCoeffs")
    if each is None:
        K = np.asarray(row["K"], dtype=np.float64).reshape(3, 3).T
        return (lens(K[0, 0], K[1, 1], K[0, 2], K[1, 2], size_px=size),) * count
    numbers = np.asarray(each, dtype=np.float64).reshape(count, -1)[:, :4]
    return tuple(lens(*values, size_px=size) for values in numbers.tolist())
