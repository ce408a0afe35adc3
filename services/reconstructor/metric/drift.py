"""How far a map's size may be off beside the length that tells its scale: poses are wrong together, and bend it."""

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.spatial.transform import Rotation

from readygo.common.arrays import Float64Array
from readygo.services.reconstructor.posed import PosedImages

CORRELATED = 3.0
"""Poses are off by so many times what their residuals say as if matches erred independently, which those of one surface
do not: 2.7, 2.5 and 3.5 times in three simulated films (`python -m experiments.reconstruction.poses`)."""
IMAGES_MAX = 400
"""Most images of a map that are looked at: time and memory grow with their square."""
_DRIFT_MAX = 0.05
"""What drifts more is not held together by its matches alone: pieces that markers join have a size that they give."""
_NUDGE = 1e-6
"""Change of a pose that derivatives are taken with, in radians and in units of the map's size."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PoseErrors:
    """What the residuals of a map's matches say of the errors of its poses, as if they erred independently."""

    names: tuple[str, ...]
    """Names of the images."""
    covariance: Float64Array
    """Joint covariance of all poses: rotation vector [rad], from the left, and translation [units of the map] of
    T_camera_world, image after image, shape (6 V, 6 V)."""


def images_to_look_at(names: tuple[str, ...], needed: Collection[str]) -> list[str]:
    """Images of a map, where there are too many half of them evenly spread, half so of those that are needed."""
    if len(names) <= IMAGES_MAX:
        return list(names)
    chosen = {*_spread(names), *_spread([name for name in names if name in needed])}
    return [name for name in names if name in chosen]


def _spread(names: Sequence[str]) -> Sequence[str]:
    return names[:: max(1, -(-len(names) // (IMAGES_MAX // 2)))]


def drift(
    images: PosedImages, errors: PoseErrors, measure: Callable[[PosedImages], float], needed: Collection[str]
) -> float | None:
    """Relative standard deviation of a map's size in units of a length in it; None if its matches do not tell.

    Its size is the root mean square distance of the cameras from their middle. To first order; a motion, a turn
    or a scaling of the whole map changes nothing.

    Args:
        images: The map.
        errors: Errors of its poses, or of the poses of some of its images, without the others.
        measure: A length in a map [units of the map]; it is given the images that `errors` are of.
        needed: Images whose poses change that length.
    """
    images = images.only(errors.names)
    length, size = measure(images), _size(images.T_world_camera)
    steps = _NUDGE * np.array([1.0, 1.0, 1.0, size, size, size])
    gradient = np.zeros((len(images.names), 6))
    for row, name in enumerate(images.names):
        for k, step in enumerate(steps):
            T_world_camera = images.T_world_camera.copy()
            T_world_camera[row] = _nudge_pose(T_world_camera[row], k, step)
            change = -np.log(_size(T_world_camera) / size)
            if name in needed:
                change += np.log(measure(replace(images, T_world_camera=T_world_camera)) / length)
            gradient[row, k] = change / step
    flat = gradient.ravel()
    sigma = CORRELATED * float(np.sqrt(flat @ errors.covariance @ flat))
    return sigma if sigma <= _DRIFT_MAX else None


def _size(T_world_camera: Float64Array) -> float:
    centres = T_world_camera[:, :3, 3]
    return float(np.sqrt(((centres - centres.mean(axis=0)) ** 2).sum(axis=1).mean()))


def _nudge_pose(T_world_camera: Float64Array, k: int, step: float) -> Float64Array:
    """A pose of which a rotation (k < 3) or a translation of its inverse is changed, as `PoseErrors` has them."""
    T_camera_world = np.linalg.inv(T_world_camera)
    if k < 3:
        T_camera_world[:3, :3] = Rotation.from_rotvec(step * np.eye(3)[k]).as_matrix() @ T_camera_world[:3, :3]
    else:
        T_camera_world[k - 3, 3] += step
    return np.linalg.inv(T_camera_world)
