"""Ground truth of a simulated capture: NAME.truth.json beside the video or the folder of photos.

format             "readygo capture truth 1"
scene              name, path and content_hash of the scene that was filmed
seed, fps, seconds how it was filmed
width_px, height_px
camera             model "OPENCV", fx, fy, cx, cy [px], pixel centres at +0.5, and k1, k2, p1, p2 of Brown-Conrady; or
                   model "EQUIRECTANGULAR" for images of 360 degrees, whose middle is along the pose's z
metres_per_unit    1: all lengths are metres of the scene's own frame, z up
frames             image (its number in the video, from 0, or the name of the photo), time_s, exposure_ev and
                   T_world_camera (4x4, OpenCV axes; with a shutter, of the middle row's middle)
people             avatars of the people who walk through it; NAME.masks has a mask of each image, 0 where they are
marker             null, or id, dictionary, size_m and corners_m (4x3): upper left, upper right, lower right,
                   lower left as printed, in the world
"""

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.documents import read_json
from readygo.common.errors import SceneError
from readygo.common.files import write_whole
from readygo.services.reconstructor import view_rotations

FORMAT = "readygo capture truth 1"
EQUIRECTANGULAR = "EQUIRECTANGULAR"
"""Model of a camera of 360 degrees, as COLMAP calls it."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Truth:
    """Content of a truth file."""

    content: dict[str, Any]
    """All keys of the file, as listed in the module's docstring."""

    @property
    def poses(self) -> dict[str, Float64Array]:
        """`T_world_camera`, shape (4, 4), by the names that `readygo scene poses` gives to images or their views."""
        poses = {image_name(row["image"]): np.array(row["T_world_camera"]) for row in self.content["frames"]}
        if self.content.get("camera", {}).get("model") != EQUIRECTANGULAR:
            return poses
        views = view_rotations().items()
        return {f"{view}/{name}": _turn(T, R) for view, R in views for name, T in poses.items()}


def _turn(T_world_panorama: Float64Array, R_panorama_view: Float64Array) -> Float64Array:
    """Pose of a view of a 360-degree image, shape (4, 4)."""
    T = T_world_panorama.copy()
    T[:3, :3] = T[:3, :3] @ R_panorama_view
    return T


def image_name(image: int | str) -> str:
    """The name that `readygo scene poses` gives to a frame of a video, by its number, or to a photo."""
    return f"{image:06d}.jpg" if isinstance(image, int) else f"{Path(image).stem}.jpg"


def truth_path(capture: Path) -> Path:
    """Path of the truth file of a video or a folder of photos."""
    return capture.with_name(f"{capture.stem}.truth.json")


def write_truth(path: Path, content: dict[str, Any]) -> None:
    """Write a truth file; the format is added."""
    write_whole(path, json.dumps({"format": FORMAT, **content}, indent=1) + "\n", raises=SceneError)


def read_truth(path: Path) -> Truth:
    """Read a truth file.

    Raises:
        SceneError: If the file is not a truth file.
    """
    try:
        content = read_json(path)
    except (OSError, ValueError) as error:
        raise SceneError(f"{path} cannot be read: {getattr(error, 'strerror', None) or error}.") from error
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise SceneError(f"{path} is no truth of a capture; `readygo scene capture` writes one beside its video.")
    return Truth(content=content)
