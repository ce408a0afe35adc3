"""Clearance of cells, and the areas that a disc can reach."""

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Int32Array, Int64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps.grid import OccupancyMap

_FAR = np.int32(1 << 15)
"""Longer column distances [half cells] count as this; its square still fits 32 bits."""


@kernel_with_cache
def _column_distance(occupied: BoolArray, far: int, out: Int32Array) -> None:
    """Distance to the nearest occupied edge in the same column [half cells]; beyond the grid is occupied."""
    rows, columns = occupied.shape
    for j in range(columns):
        gap = -1
        for i in range(rows):
            gap = 0 if occupied[i, j] else min(gap + 2 if gap > 0 else 1, far)
            out[i, j] = gap
        gap = -1
        for i in range(rows - 1, -1, -1):
            gap = 0 if occupied[i, j] else min(gap + 2 if gap > 0 else 1, far)
            out[i, j] = min(out[i, j], gap)


@kernel_with_cache
def _clearance(vertical: Int32Array, half_cell_m: float, out: Float32Array) -> None:
    rows, columns = vertical.shape
    for i in range(rows):
        for j in range(columns):
            best = vertical[i, j] * vertical[i, j]
            for step in range(1, columns + 1):
                side = (2 * step - 1) * (2 * step - 1)
                if side >= best:
                    break
                left = vertical[i, j - step] if j >= step else 0
                right = vertical[i, j + step] if j + step < columns else 0
                nearest = min(left, right)
                best = min(best, side + nearest * nearest)
            out[i, j] = np.sqrt(float(best)) * half_cell_m


def clearance_m(occupancy: OccupancyMap) -> Float32Array:
    """Distance from each cell's centre to the nearest point of an occupied cell [m]; 0 inside occupied cells.

    Exact for the cells as squares (not for their centres): a disc of radius r on a cell's centre touches an occupied
    cell exactly if its clearance is at most r. Everything beyond the grid counts as occupied. Elsewhere in the cell
    the distance is smaller by at most half a cell's diagonal.

    Args:
        occupancy: Map, not inflated.

    Returns:
        Clearances [m], shape (H, W).
    """
    vertical = np.empty(occupancy.occupied.shape, np.int32)
    _column_distance(occupancy.occupied, int(_FAR), vertical)
    out = np.empty(vertical.shape, np.float32)
    _clearance(vertical, 0.5 * occupancy.frame.resolution_m, out)
    return out


def free_components(free: BoolArray) -> tuple[Int32Array, Int64Array]:
    """Connected areas of free cells (neighbours share an edge).

    Args:
        free: True where an agent's centre may be, shape (H, W).

    Returns:
        Labels, shape (H, W): 0 is blocked, 1 the largest area, 2 the next; and the cells of each label, shape (L + 1,).
    """
    from scipy import ndimage

    labels, count = ndimage.label(free)
    sizes = np.bincount(labels.reshape(-1), minlength=count + 1)
    order = np.argsort(-sizes[1:], kind="stable")
    rank = np.zeros(count + 1, np.int32)
    rank[order + 1] = np.arange(1, count + 1)
    return rank[labels], np.concatenate([sizes[:1], sizes[1:][order]]).astype(np.int64)


def farthest_m(labels: Int32Array, resolution_m: float) -> float:
    """The longest straight distance of two cells of one area [m], up to 1 %.

    Args:
        labels: Areas as of `free_components`, 0 where no agent can be, shape (H, W).
        resolution_m: Edge of a cell [m].
    """
    rows, columns = np.nonzero(labels)
    if len(rows) == 0:
        return 0.0
    area = labels[rows, columns] - 1
    longest = 0.0
    for angle in np.linspace(0.0, np.pi, 24, endpoint=False).tolist():
        at = columns * np.cos(angle) + rows * np.sin(angle)
        high, low = np.full(area.max() + 1, -np.inf), np.full(area.max() + 1, np.inf)
        np.maximum.at(high, area, at)
        np.minimum.at(low, area, at)
        longest = max(longest, float((high - low)[np.isfinite(low)].max()))
    return longest * resolution_m


def largest_free_area(occupancy: OccupancyMap, radius_m: float) -> tuple[BoolArray, float]:
    """The largest connected set of cells on whose centres a disc stands clear of everything.

    Args:
        occupancy: Map, not inflated.
        radius_m: Radius of the disc [m].

    Returns:
        The cells, shape (H, W), and their area [m2], 0 if there are none.
    """
    labels, sizes = free_components(clearance_m(occupancy) > radius_m)
    area_m2 = float(sizes[1]) * occupancy.frame.resolution_m**2 if len(sizes) > 1 else 0.0
    return labels == 1, area_m2
