"""The local floor of a scene: uneven, tilted, partly hidden."""

import math
from dataclasses import dataclass, replace

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.errors import NoGroundError
from readygo.common.gaussians import GaussianCloud
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps.fill import box_mean, fill_smoothly
from readygo.common.maps.floor_layers import COLUMN_M, SLOPE_MAX, CoarseFloor, find_coarse_floor
from readygo.common.maps.grid import FloorMap, GridFrame
from readygo.common.maps.surface import SurfaceSamples, sample_surfaces

AREA_MIN_M2 = 2.0
"""Smaller surfaces are objects, not floors [m2]."""
BAND_M = 0.15
"""Surfaces within this of the coarse floor take part in the local one [m]."""
BIN_M = 0.01
COVERAGE_MIN = 0.2
"""A cell has floor if lying Gaussians cover this part of its surroundings within SUPPORT_M of the floor."""
SUPPORT_M = 0.05
HALF_ABSORBED = 0.5 * math.log(2.0)
"""Coverage (1-sigma area times opacity, which is half of a Gaussian's optical depth) that halves the light."""
GAP_MAX_M = 0.25
"""Gaps in the support up to twice this wide, and up to four cells, are closed [m]."""
WALKED_M, STRIDE_M = 0.25, 1.0
"""A person who films stands on floor: so far around each camera, and on the way to the next one if it is not farther
[m]."""
WALKED_HEIGHTS_M = (0.4, 2.2)
"""Cameras that are held, or stand on a robot, are this high above the floor [m]."""
MARGIN_M = 0.5
"""The maps reach this far beyond the floor [m]."""
CELLS_MAX = 16_000_000
"""Largest number of map cells."""

_BINS = round(2 * BAND_M / BIN_M)


@dataclass(frozen=True, kw_only=True, eq=False)
class FloorEstimate:
    """Height of the floor, and where the scene shows one."""

    floor: FloorMap
    supported: BoolArray
    """True where floor is seen, or hidden by a small gap only; same grid as the floor, shape (H, W)."""
    relief_m: Float64Array
    """World z of what is seen of the floor before it is smoothed [m]: its bulges too, where they rise no faster than
    SLOPE_MAX, never below the floor, shape (H, W)."""
    step_m: Float64Array
    """By how much what is seen is higher than that, mean of 3x3 cells [m]: little on rough ground, much at the sharp
    edges of low boxes, shape (H, W)."""


def estimate_floor(cloud: GaussianCloud, cell_m: float) -> FloorEstimate:
    """Find the floor of a scene and its height everywhere around.

    The lowest of the large, continuous, roughly level surfaces is the floor. In each cell its height is that of the
    visible surface, seen from above, among the lying Gaussians within BAND_M of it (glossy floors have layers of
    reflections below the visible one); median-filtered, and continued smoothly where the floor is hidden.

    Args:
        cloud: Gaussians, metres, z up.
        cell_m: Edge of the floor map's cells [m].

    Raises:
        NoGroundError: If there is no floor, or the map would be too large.
    """
    coarse = find_coarse_floor(sample_surfaces(cloud, COLUMN_M / 2))
    if coarse is None or coarse.area_m2 < AREA_MIN_M2:
        found_m2 = 0.0 if coarse is None else coarse.area_m2
        raise NoGroundError(
            f"The scene has no floor: the largest level surface covers {found_m2:.1f} m2, {AREA_MIN_M2:.0f} m2 are "
            "needed; check the up axis and the scale, or import a whole place instead of an object."
        )
    frame, shape = _fine_grid(coarse, cell_m)
    prior = _prior(coarse, frame, shape)
    masses = np.zeros((*shape, _BINS), np.float32)
    _histogram(*_arrays(sample_surfaces(cloud, cell_m)), prior, frame.origin_x_m, frame.origin_y_m, cell_m, masses)
    offset, covered_m2 = _visible_offset(masses, cell_m * cell_m)
    known = covered_m2 >= COVERAGE_MIN * cell_m * cell_m
    if not known.any():
        raise NoGroundError("The scene has no floor: its level surfaces are too faint; check the scale.")
    height = _smooth_heights(prior + offset, known)
    floor = FloorMap(frame=frame, height_m=height.astype(np.float32))
    seen = np.where(known, prior + offset, height)
    gentle = _gentle(seen, cell_m)
    return FloorEstimate(
        floor=floor,
        supported=_close_gaps(known, cell_m),
        relief_m=np.maximum(height, gentle),
        step_m=box_mean(np.where(known, seen - gentle, 0.0)),
    )


def complete_floor(estimate: FloorEstimate, cameras_m: Float64Array) -> FloorEstimate:
    """An estimate whose floor is complete where the person who filmed walked: cameras seldom see what is below them.

    Args:
        estimate: Estimate of the scene's floor.
        cameras_m: Centres of cameras in the order in which they filmed, shape (N, 3) [m].
    """
    from scipy import ndimage

    frame = estimate.floor.frame
    height_m = cameras_m[:, 2] - estimate.floor.at_many(cameras_m[:, :2])
    held = cameras_m[(height_m >= WALKED_HEIGHTS_M[0]) & (height_m <= WALKED_HEIGHTS_M[1]), :2]
    share = np.arange(0.0, 1.0, frame.resolution_m / STRIDE_M)[:, None, None]
    near = np.hypot(*(held[1:] - held[:-1]).T) <= STRIDE_M
    between = (held[:-1] + share * (held[1:] - held[:-1]))[:, near].reshape(-1, 2)
    i, j = frame.cells(np.concatenate([held, between]))
    inside = (i >= 0) & (j >= 0) & (i < estimate.supported.shape[0]) & (j < estimate.supported.shape[1])
    way = np.ones(estimate.supported.shape, np.bool_)
    way[i[inside], j[inside]] = False
    if way.all():
        return estimate
    trodden = ndimage.distance_transform_edt(way) * frame.resolution_m <= WALKED_M
    return replace(estimate, supported=estimate.supported | trodden)


def _arrays(samples: SurfaceSamples) -> tuple[Float32Array, Float32Array]:
    return samples.xyz_m, samples.area_m2


def _fine_grid(coarse: CoarseFloor, cell_m: float) -> tuple[GridFrame, tuple[int, int]]:
    """A grid around the coarse floor; its origin is a multiple of the cell."""
    rows, columns = np.nonzero(np.isfinite(coarse.height_m))
    low = (np.array([columns.min(), rows.min()]) * COLUMN_M) + (coarse.frame.origin_x_m, coarse.frame.origin_y_m)
    high = low + (np.array([np.ptp(columns), np.ptp(rows)]) + 1) * COLUMN_M
    first = np.floor((low - MARGIN_M) / cell_m)
    width, height = np.ceil((high + MARGIN_M) / cell_m - first).astype(int).tolist()
    if 4 * width * height > CELLS_MAX:
        raise NoGroundError(
            f"The floor spans {high[0] - low[0]:.0f} x {high[1] - low[1]:.0f} m: over {CELLS_MAX // 10**6} million "
            f"cells of {cell_m / 2:g} m; use a coarser resolution, for example {cell_m:g} m, or --crop the scene."
        )
    frame = GridFrame(origin_x_m=float(first[0]) * cell_m, origin_y_m=float(first[1]) * cell_m, resolution_m=cell_m)
    return frame, (height, width)


def _prior(coarse: CoarseFloor, frame: GridFrame, shape: tuple[int, int]) -> Float64Array:
    """The coarse floor, without gaps, at the centres of a finer grid."""
    filled = fill_smoothly(coarse.height_m, np.isfinite(coarse.height_m))
    surface = FloorMap(frame=coarse.frame, height_m=filled.astype(np.float32))
    xy = np.stack(np.meshgrid(*frame.centre_m(np.arange(shape[0]), np.arange(shape[1]))), axis=-1)
    return surface.at_many(xy.reshape(-1, 2)).reshape(shape)


@kernel_with_cache
def _histogram(
    xyz: Float32Array,
    area: Float32Array,
    prior: Float64Array,
    origin_x: float,
    origin_y: float,
    cell: float,
    masses: Float32Array,
) -> None:
    for n in range(len(area)):
        i, j = math.floor((xyz[n, 1] - origin_y) / cell), math.floor((xyz[n, 0] - origin_x) / cell)
        if i < 0 or j < 0 or i >= prior.shape[0] or j >= prior.shape[1]:
            continue
        b = math.floor((xyz[n, 2] - prior[i, j] + BAND_M) / BIN_M)
        if 0 <= b < masses.shape[2]:
            masses[i, j, b] += area[n]


@kernel_with_cache
def _visible_offset(masses: Float32Array, cell_m2: float) -> tuple[Float64Array, Float64Array]:
    """Visible height above the prior in 3x3 cells [m], and the area covered near it, per cell [m2].

    Visible is the height at which half of the light from above is absorbed, or half of all there is.
    """
    rows, columns, bins = masses.shape
    offset, covered = np.zeros((rows, columns)), np.zeros((rows, columns))
    window = np.empty(bins)
    reach = round(SUPPORT_M / BIN_M)
    for i in range(rows):
        for j in range(columns):
            window[:] = 0.0
            cells = 0
            for di in range(max(i - 1, 0), min(i + 2, rows)):
                for dj in range(max(j - 1, 0), min(j + 2, columns)):
                    cells += 1
                    for b in range(bins):
                        window[b] += masses[di, dj, b]
            total = window.sum()
            if total <= 0.0:
                continue
            limit = min(0.5 * total, cells * cell_m2 * HALF_ABSORBED)
            above, b = 0.0, bins - 1
            while above + window[b] < limit:
                above += window[b]
                b -= 1
            offset[i, j] = (b + 1 - (limit - above) / window[b]) * BIN_M - BAND_M
            covered[i, j] = window[max(0, b - reach) : b + reach + 1].sum() / cells
    return offset, covered


def _smooth_heights(height_m: Float64Array, known: BoolArray) -> Float64Array:
    from scipy import ndimage

    filled = fill_smoothly(height_m, known)
    median: Float64Array = ndimage.median_filter(filled, size=5, mode="nearest")
    return box_mean(median)


def _gentle(height_m: Float64Array, cell_m: float) -> Float64Array:
    """The highest surface below this one that is nowhere steeper than SLOPE_MAX: bulges stay, steps become ramps."""
    from scipy import ndimage

    reach = max(1, round(BAND_M / SLOPE_MAX / cell_m))
    i, j = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    cone = -SLOPE_MAX * cell_m * np.sqrt(i * i + j * j)
    gentle: Float64Array = ndimage.grey_erosion(height_m, structure=cone, mode="nearest")
    return gentle


def _close_gaps(known: BoolArray, cell_m: float) -> BoolArray:
    """Morphological closing by a disc."""
    from scipy import ndimage

    reach = max(2, round(GAP_MAX_M / cell_m))
    i, j = np.mgrid[-reach : reach + 1, -reach : reach + 1]
    disc = i * i + j * j <= reach * reach
    padded = np.pad(known, reach)
    closed: BoolArray = ndimage.binary_closing(padded, disc)[reach:-reach, reach:-reach]
    return closed
