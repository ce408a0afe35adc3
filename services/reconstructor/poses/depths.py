"""How long the depths that a device measured are in a map, by the points that its images see."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from readygo.common.errors import SceneError
from readygo.services.reconstructor.frames.depths import STEP_M, read_steps
from readygo.services.reconstructor.poses.colmap import open_model, posed_images

_POINTS_MIN = 50
"""Fewer sightings of points with a depth say nothing."""
_UNIT_ERROR_MAX = 0.2
"""Depths that differ more from the poses of a device that measured both have another unit."""
_SPREAD_MAX = 0.2
"""Depths that differ more from the map's, half the distance of the quartiles relative to the median, are of another
view, or have no unit."""


@dataclass(frozen=True, kw_only=True)
class DepthRatio:
    """Depths of points in a map against those that a device measured."""

    units_per_metre: float
    """Units of the map per metre of the device: the median."""
    spread: float
    """Half the distance between the quartiles, relative to the median."""
    sightings: int
    images: int


def depth_ratio(model: Path, depths: Path) -> DepthRatio | None:
    """Compare depth images with the points of a COLMAP model.

    Args:
        model: The model.
        depths: Folder of its images' depth images, NAME.png, see `read_steps`; some may be missing.

    Returns:
        None if too few points have a depth.

    Raises:
        SceneError: If the depths do not fit.
    """
    rec, ratios, images = open_model(model), [], 0
    for image in posed_images(rec):
        steps = read_steps(depths / f"{image.name}.png")
        seen = [point for point in image.points2D if point.has_point3D()]
        if steps is None or not seen:
            continue
        points = np.array([rec.points3D[point.point3D_id].xyz for point in seen])
        z = np.asarray(image.cam_from_world() * points)[:, 2]
        side, size = np.array(steps.shape[::-1]), np.array([image.camera.width, image.camera.height])
        pixels = np.floor(np.array([point.xy for point in seen]) * side / size).astype(np.int64)
        u, v = np.clip(pixels, 0, side - 1).T
        known = (steps[v, u] > 0) & (z > 0)
        ratios.append(z[known] / (STEP_M * steps[v, u][known]))
        images += bool(known.any())
    found = np.concatenate(ratios) if ratios else np.empty(0)
    if len(found) < _POINTS_MIN:
        return None
    low, middle, high = np.percentile(found, [25.0, 50.0, 75.0])
    ratio = DepthRatio(
        units_per_metre=float(middle), spread=float(0.5 * (high - low) / middle), sightings=len(found), images=images
    )
    if ratio.spread > _SPREAD_MAX:
        raise SceneError(
            f"Depth images do not fit their images: against the depths of {len(found)} points they are "
            f"{1 / high:.3g} to {1 / low:.3g} times as long. Depth along the optical axis is needed, of the same view; "
            "--frames.depth false leaves depth images out."
        )
    return ratio


def check_unit(ratio: DepthRatio) -> None:
    """Check that depths have the unit of poses in metres.

    Raises:
        SceneError: If they have another one.
    """
    longer = 1.0 / ratio.units_per_metre
    if abs(np.log(longer)) > np.log1p(_UNIT_ERROR_MAX):
        raise SceneError(
            f"Depth images are {longer:.3g} times as long as the same device's poses say: 16-bit images must be in "
            "millimetres, floats in metres; --frames.depth false leaves depth images out."
        )
