"""Ground that was not filmed: a few huge Gaussians stand for it, and images of it are a blur."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.maps.grid import FloorMap
from readygo.common.maps.surface import sample_surfaces

BAND_M = 0.15
"""Lying Gaussians within this of the floor are the ground [m]."""
COARSE_M = 0.25
"""Gaussians of filmed ground are smaller (standard deviation) [m],"""
COARSE_RATIO = 4.0
"""or smaller than this many times the scene's usual ones."""
SHARE_MIN = 0.8
"""Ground is coarse where large Gaussians have at least this share of it."""
BLURRED_M = 0.2
"""Images over ground of Gaussians larger than this (standard deviation) are blurred [m]."""
WIDTH_M = 1.0
"""Narrower patches and gaps are smoothed away: what a rug or a shadow leaves is no border [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class GroundDetail:
    """How fine the Gaussians are that the ground consists of; masks have the floor's grid, shape (H, W)."""

    coarse: BoolArray
    """Cells that were not filmed from near."""
    blurred: BoolArray
    """Cells of Gaussians above BLURRED_M; coarse ones may be among them."""
    size_m: float
    """Usual size of all that the ground consists of: median of the largest standard deviations [m]."""


def ground_detail(cloud: GaussianCloud, floor: FloorMap, known: BoolArray) -> GroundDetail:
    """Find the cells whose ground consists of large Gaussians.

    Args:
        cloud: Gaussians, metres, z up.
        floor: The local floor.
        known: Cells with floor, shape (H, W) of the floor's grid.
    """
    height_m = cloud.means_m[:, 2] - floor.at_many(cloud.means_m[:, :2].astype(np.float64))
    ground = cloud.select(np.abs(height_m) < BAND_M)
    usual_m = float(np.median(ground.scales_m.max(axis=1))) if len(ground) else 0.0
    limits_m = max(COARSE_M, COARSE_RATIO * usual_m), BLURRED_M
    coarse, blurred = (_mostly_larger(ground, limit_m, floor, known) for limit_m in limits_m)
    return GroundDetail(coarse=coarse, blurred=blurred, size_m=usual_m)


def _mostly_larger(ground: GaussianCloud, limit_m: float, floor: FloorMap, known: BoolArray) -> BoolArray:
    """Cells around which Gaussians above a size have SHARE_MIN of the ground."""
    from scipy import ndimage

    reach_m = ground.scales_m.max(axis=1)
    large, small = (_covered_m2(ground.select(part), floor) for part in (reach_m > limit_m, reach_m <= limit_m))
    covered = large + small
    share = np.divide(large, covered, out=np.zeros_like(large), where=covered > 0)
    size = max(3, round(WIDTH_M / floor.frame.resolution_m))
    weights = ndimage.uniform_filter(known.astype(np.float64), size)
    mean = ndimage.uniform_filter(np.where(known, share, 0.0), size)
    larger: BoolArray = known & (mean >= SHARE_MIN * weights)
    return larger


def _covered_m2(cloud: GaussianCloud, floor: FloorMap) -> Float64Array:
    """Area that lying Gaussians cover in each cell of the floor [m2]."""
    samples = sample_surfaces(cloud, floor.frame.resolution_m)
    rows, columns = floor.height_m.shape
    i, j = floor.frame.cells(samples.xyz_m[:, :2])
    inside = (i >= 0) & (j >= 0) & (i < rows) & (j < columns)
    flat = np.bincount((i * columns + j)[inside], samples.area_m2[inside], rows * columns)
    covered: Float64Array = flat.reshape(rows, columns).astype(np.float64)
    return covered
