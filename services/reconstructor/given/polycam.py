"""Raw data of Polycam: `keyframes/images/N.jpg` with `keyframes/cameras/N.json` (or `corrected_...` of both).

A camera has fx, fy, cx, cy, width, height [px] and t_00 to t_23, its pose in ARKit's world: metres, y up, and camera
axes of OpenGL. Corrected cameras are those that Polycam has optimised; their images are without distortion.
`keyframes/depth/N.png` and `keyframes/confidence/N.png` are ARKit's, of both kinds of images.

Source: PolyCam/polyform, README, "Raw data".
"""

from pathlib import Path

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.documents import read_json
from readygo.common.errors import SceneError
from readygo.common.frames import swap_opengl_axes
from readygo.services.reconstructor.given.capture import GivenCapture, image_file, named_error
from readygo.services.reconstructor.given.depth import LIDAR_FAR_M, find_depth
from readygo.services.reconstructor.poses.intrinsics import Intrinsics, lens_of_row

_KIND = "a camera of Polycam"
_FOLDERS = (("corrected_images", "corrected_cameras"), ("images", "cameras"))


def find_polycam(folder: Path) -> tuple[Path, Path] | None:
    """Folders of images and cameras, corrected ones first; None if there are none."""
    for place in (folder / "keyframes", folder):
        for images, cameras in _FOLDERS:
            if (place / images).is_dir() and any((place / cameras).glob("*.json")):
                return place / images, place / cameras
    return None


def read_polycam(images: Path, cameras: Path) -> GivenCapture:
    """Read the cameras of an export.

    Args:
        images: Folder of the images.
        cameras: Folder of the cameras' files.

    Raises:
        SceneError: If a camera is incomplete or impossible.
    """
    files = sorted(cameras.glob("*.json"))
    read = [_camera(file) for file in files]
    try:
        return GivenCapture(
            kind="Polycam",
            files=tuple(files),
            images=tuple(image_file(images, file.stem) for file in files),
            lenses=tuple(lens for lens, _ in read),
            T_world_camera=swap_opengl_axes(np.array([T for _, T in read]).reshape(-1, 4, 4)),
            metric=True,
            rough=cameras.name == "cameras",
            up=(0.0, 1.0, 0.0),
            depth=tuple(
                find_depth(
                    images.parent / "depth" / f"{file.stem}.png",
                    images.parent / "confidence" / f"{file.stem}.png",
                    far_m=LIDAR_FAR_M,
                )
                for file in files
            ),
        )
    except ValueError as error:
        raise named_error(cameras, _KIND, error) from error


def _camera(file: Path) -> tuple[Intrinsics, Float64Array]:
    try:
        row = read_json(file)
        T = np.eye(4)
        T[:3] = [[float(row[f"t_{i}{j}"]) for j in range(4)] for i in range(3)]
        return lens_of_row({name: row[name] for name in ("fx", "fy", "cx", "cy", "width", "height")}), T
    except (OSError, KeyError, TypeError, ValueError, OverflowError) as error:
        raise named_error(file, _KIND, error) from error


def check_polycam(folder: Path) -> None:
    """Say what is missing where a folder is an export of Polycam without raw data.

    Raises:
        SceneError: If there are key frames, but no cameras.
    """
    if (folder / "keyframes").is_dir():
        raise SceneError(f"{folder}/keyframes has no images with cameras; export the raw data from Polycam.")
