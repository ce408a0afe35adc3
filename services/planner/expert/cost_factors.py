"""The expert's map: what driving over each cell costs, with the humans that it knows painted in.

Legend: (i, j) row and column of a cell, its centre at (ox + (j + 0.5) resolution, oy + (i + 0.5) resolution) [m]; a
factor of `FREE` is free ground, twice that costs twice as much, 0 is blocked. A capsule is all that is nearer than its
radius to the segment a..b.
"""

import math

import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.episode.grid_search import FREE
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import GridFrame


def static_factor(clearance: Float64Array, blocked_m: float, *, wall_cost: float, wall_distance_m: float) -> UInt8Array:
    """Cost factors of a map without humans.

    Args:
        clearance: Distance to obstacles [m], shape (H, W).
        blocked_m: Cells this near to an obstacle are blocked [m].
        wall_cost: Extra cost at this distance, as a share of free ground.
        wall_distance_m: Width of the strip over which the extra falls off [m].
    """
    nearness = np.clip(1.0 - (clearance - blocked_m) / max(wall_distance_m, 1e-9), 0.0, 1.0)
    factor = np.rint(FREE * (1.0 + wall_cost * nearness)).astype(np.uint8)
    return np.where(clearance > blocked_m, factor, np.uint8(0)).astype(np.uint8)


@kernel_with_cache
def segment_distance(x: float, y: float, ax: float, ay: float, bx: float, by: float) -> float:
    """Distance of a point to a segment."""
    # The nearest point is a + t (b - a), t = (p - a) . (b - a) / |b - a|^2, kept within 0..1.
    dx, dy = bx - ax, by - ay
    squared = dx * dx + dy * dy
    t = 0.0 if squared < 1e-12 else min(max(((x - ax) * dx + (y - ay) * dy) / squared, 0.0), 1.0)
    ex, ey = x - ax - t * dx, y - ay - t * dy
    return math.sqrt(ex * ex + ey * ey)


@kernel_with_cache
def _paint_capsule(
    factor: UInt8Array,
    ox: float,
    oy: float,
    resolution: float,
    ends: tuple[float, float, float, float],
    radius: float,
    value: int,
    sloped: bool,
) -> None:
    """Set the cells of a capsule to a factor, or raise them by what falls linearly from its middle to its rim."""
    height, width = factor.shape
    ax, ay, bx, by = ends
    i_first = max(0, math.floor((min(ay, by) - radius - oy) / resolution))
    i_last = min(height - 1, math.floor((max(ay, by) + radius - oy) / resolution))
    j_first = max(0, math.floor((min(ax, bx) - radius - ox) / resolution))
    j_last = min(width - 1, math.floor((max(ax, bx) + radius - ox) / resolution))
    for i in range(i_first, i_last + 1):
        y = oy + (i + 0.5) * resolution
        for j in range(j_first, j_last + 1):
            if factor[i, j] == 0:
                continue
            x = ox + (j + 0.5) * resolution
            distance = segment_distance(x, y, ax, ay, bx, by)
            if distance >= radius:
                continue
            if not sloped:
                factor[i, j] = value
                continue
            nearness = 1.0 - distance / radius
            factor[i, j] = max(factor[i, j], int(FREE + (value - FREE) * nearness))


def paint_capsule(
    factor: UInt8Array,
    frame: GridFrame,
    ends_m: tuple[float, float, float, float],
    radius_m: float,
    value: int,
) -> None:
    """Set cells within `radius_m` of a segment (ax, ay, bx, by) to a factor; blocked cells stay blocked."""
    _paint_capsule(factor, frame.origin_x_m, frame.origin_y_m, frame.resolution_m, ends_m, radius_m, value, False)


def paint_slope(
    factor: UInt8Array,
    frame: GridFrame,
    ends_m: tuple[float, float, float, float],
    radius_m: float,
    value: int,
) -> None:
    """Raise factors within `radius_m` of a segment, up to `value` on it; blocked cells stay blocked."""
    _paint_capsule(factor, frame.origin_x_m, frame.origin_y_m, frame.resolution_m, ends_m, radius_m, value, True)


@kernel_with_cache
def _paint_points(
    factor: UInt8Array,
    ox: float,
    oy: float,
    resolution: float,
    points: Float64Array,
    radius: float,
    value: int,
) -> None:
    height, width = factor.shape
    reach = math.ceil(radius / resolution)
    limit = radius / resolution
    seen = set()
    for n in range(len(points)):
        i = math.floor((points[n, 1] - oy) / resolution)
        j = math.floor((points[n, 0] - ox) / resolution)
        if (i, j) in seen:
            continue
        seen.add((i, j))
        for ii in range(max(0, i - reach), min(height, i + reach + 1)):
            for jj in range(max(0, j - reach), min(width, j + reach + 1)):
                if (ii - i) ** 2 + (jj - j) ** 2 >= limit * limit:
                    continue
                if factor[ii, jj] != 0 and (value == 0 or factor[ii, jj] < value):
                    factor[ii, jj] = value


def paint_points(factor: UInt8Array, frame: GridFrame, points_m: Float64Array, radius_m: float, value: int) -> None:
    """Set cells within `radius_m` of points (N, 2) to a factor; blocked cells stay blocked."""
    _paint_points(factor, frame.origin_x_m, frame.origin_y_m, frame.resolution_m, points_m, radius_m, value)


@kernel_with_cache
def _open_around(
    factor: UInt8Array, clearance: Float64Array, i: int, j: int, reach: int, needed: float, value: int
) -> None:
    height, width = factor.shape
    for ii in range(max(0, i - reach), min(height, i + reach + 1)):
        for jj in range(max(0, j - reach), min(width, j + reach + 1)):
            if factor[ii, jj] == 0 and clearance[ii, jj] > needed and (ii - i) ** 2 + (jj - j) ** 2 <= reach * reach:
                factor[ii, jj] = value


def open_around(
    factor: UInt8Array,
    frame: GridFrame,
    clearance: Float64Array,
    xy_m: tuple[float, float],
    needed_m: float,
    value: int,
) -> None:
    """Make the cells within 0.4 m of a point passable where obstacles are farther than `needed_m`.

    A robot that tracks a path along the planning distance may stand a little within it.
    """
    i, j = frame.cell(*xy_m)
    _open_around(factor, clearance, i, j, math.ceil(0.4 / frame.resolution_m), needed_m, value)


@kernel_with_cache
def path_distance(path: Float64Array, first: int, last: int, ends: tuple[float, float, float, float]) -> float:
    """Smallest distance between path points first..last-1 and a segment [m]; inf without points."""
    best = np.inf
    for k in range(first, min(last, len(path))):
        best = min(best, segment_distance(path[k, 0], path[k, 1], ends[0], ends[1], ends[2], ends[3]))
    return best


@kernel_with_cache
def _path_cost(
    path: Float64Array, first: int, factor: UInt8Array, ox: float, oy: float, resolution: float, v_max: float
) -> float:
    total = 0.0
    for k in range(first + 1, len(path)):
        i = math.floor((path[k, 1] - oy) / resolution)
        j = math.floor((path[k, 0] - ox) / resolution)
        if i < 0 or j < 0 or i >= factor.shape[0] or j >= factor.shape[1] or factor[i, j] == 0:
            return np.inf
        dx, dy = path[k, 0] - path[k - 1, 0], path[k, 1] - path[k - 1, 1]
        slowness = v_max / max(abs(path[k, 3]), 0.1 * v_max)
        total += math.sqrt(dx * dx + dy * dy) * slowness * factor[i, j] / FREE
    return total


def path_cost(path: Float64Array, first: int, factor: UInt8Array, frame: GridFrame, v_max_mps: float) -> float:
    """Time-like cost of a path from a point on [m at full speed]: length by slowness by factor; inf if blocked.

    Args:
        path: x [m], y [m], yaw [rad], speed [m/s], shape (N, 4).
        first: Index of the point to start from.
        factor: Cost factors, shape (H, W).
        frame: Where the cells lie.
        v_max_mps: Full speed [m/s].
    """
    place = (frame.origin_x_m, frame.origin_y_m, frame.resolution_m)
    return float(_path_cost(path, first, factor, *place, v_max_mps))
