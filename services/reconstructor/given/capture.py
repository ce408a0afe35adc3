"""Images with poses and lenses that another program found, in our conventions."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from readygo.common.arrays import Float64Array
from readygo.common.camera.captured import ROTATION_ERROR_MAX
from readygo.common.errors import SceneError
from readygo.services.reconstructor.given.depth import DepthFile
from readygo.services.reconstructor.poses.intrinsics import Intrinsics

IMAGES_MIN = 3
_QUATERNION_ERROR_MAX = 1e-2


@dataclass(frozen=True, kw_only=True, eq=False)
class GivenCapture:
    """N images with poses and lenses."""

    kind: str
    """What wrote it, in words."""
    files: tuple[Path, ...]
    """Files that tell the poses."""
    images: tuple[Path, ...]
    """Files; some may be missing."""
    lenses: tuple[Intrinsics, ...]
    """Of each image; without a size they are for the image as it is."""
    T_world_camera: Float64Array
    """Poses, OpenCV axes, shape (N, 4, 4)."""
    metric: bool
    """Whether the unit is the metre, as the device measured it."""
    rough: bool
    """Whether poses are those of a device while it filmed, off by centimetres, and are to be adjusted."""
    up: tuple[float, float, float] | None = None
    """Where up is, as the device measured it: a unit vector; None if that is not known."""
    depth: tuple[DepthFile | None, ...] = ()
    """Depth images, None for an image without one; empty if there are none at all."""
    video: Path | None = None
    """The images are frames of this video, with their numbers as names, ascending; None: they are files."""

    def __post_init__(self) -> None:
        if not self.depth:
            object.__setattr__(self, "depth", (None,) * len(self.images))
        if not len(self.images) == len(self.lenses) == len(self.T_world_camera) == len(self.depth):
            raise ValueError("images, lenses, poses and depth images must be as many")
        check_poses(self.T_world_camera)

    @property
    def all_files(self) -> list[Path]:
        """Files of poses, images and depths; some may be missing."""
        return [*self.files, *self.images, *(file for depth in self.depth if depth for file in depth.files)]

    def select(self, rows: Sequence[int]) -> "GivenCapture":
        """The capture with some of its images."""
        return replace(
            self,
            images=tuple(self.images[row] for row in rows),
            lenses=tuple(self.lenses[row] for row in rows),
            T_world_camera=self.T_world_camera[list(rows)],
            depth=tuple(self.depth[row] for row in rows),
        )


def check_poses(T_world_camera: Float64Array) -> None:
    """Check that poses are finite, and rotations without scale or mirror.

    Raises:
        ValueError: With the number of the first that is none.
    """
    R = T_world_camera[:, :3, :3]
    finite = np.isfinite(T_world_camera).all(axis=(1, 2))
    with np.errstate(invalid="ignore"):
        turns = np.abs(R @ R.swapaxes(1, 2) - np.eye(3)).max(axis=(1, 2), initial=0.0) < ROTATION_ERROR_MAX
        wrong = ~(finite & turns & (np.linalg.det(np.where(np.isfinite(R), R, 0.0)) > 0))
    if wrong.any():
        raise ValueError(f"the pose of frame {int(np.argmax(wrong))} is no rotation and translation")


def pose_matrices(quats_xyzw: Float64Array, positions: Float64Array) -> Float64Array:
    """Poses (N, 4, 4) of quaternions (N, 4) and positions (N, 3).

    Raises:
        ValueError: If a number is not finite, or a quaternion has not the length 1.
    """
    lengths = np.linalg.norm(quats_xyzw, axis=1)
    if not (np.isfinite(positions).all() and (np.abs(lengths - 1.0) < _QUATERNION_ERROR_MAX).all()):
        raise ValueError("a quaternion has not the length 1")
    T = np.tile(np.eye(4), (len(positions), 1, 1))
    T[:, :3, :3], T[:, :3, 3] = Rotation.from_quat(quats_xyzw).as_matrix(), positions
    return T


def image_file(folder: Path, name: str, endings: Sequence[str] = (".jpg", ".jpeg", ".png")) -> Path:
    """The image of a name without its ending; the first that could be where there is none."""
    places = [folder / f"{name}{ending}" for ending in endings]
    return next((place for place in places if place.is_file()), places[0])


def named_error(path: Path, kind: str, error: Exception) -> SceneError:
    """The error of a file that is not as its kind should be, in one line."""
    reason = f"no {error}" if isinstance(error, KeyError) else getattr(error, "strerror", None) or error
    return SceneError(f"{path} cannot be read as {kind}: {reason}.")
