"""The floor as a coarse surface: the lowest large one that the lying layers of neighbouring columns form."""

import heapq
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps.grid import GridFrame
from readygo.common.maps.surface import SurfaceSamples

COLUMN_M = 0.4
"""Edge of the coarse columns [m]."""
BIN_M = 0.05
COVERAGE_MIN = 0.2
"""A layer covers at least this part of its column."""
STEP_MAX_M = 0.15
"""Layers of neighbouring columns that differ by more do not belong to one floor [m]."""
SLOPE_MAX = 0.3
SIZE_RATIO_MIN = 0.5
"""A surface must reach this part of the largest one's area to be taken for the floor."""
EXTENT_MAX_M = 600.0
"""Samples farther than this from the median are background [m]."""

_OFFSETS = np.array([(i, j) for i in range(-2, 3) for j in range(-2, 3) if (i, j) != (0, 0)], np.int64)
_DISTANCES_M = np.sqrt((_OFFSETS * _OFFSETS).sum(axis=1)) * COLUMN_M
_TOLERANCES_M = np.minimum(STEP_MAX_M, 0.03 + SLOPE_MAX * _DISTANCES_M)


@dataclass(frozen=True, kw_only=True, eq=False)
class CoarseFloor:
    """The floor in columns of COLUMN_M."""

    frame: GridFrame
    height_m: Float64Array
    """World z [m], shape (H, W); NaN where no floor was found."""
    area_m2: float
    """Area of the floor that is covered by Gaussians [m2]."""


def find_coarse_floor(samples: SurfaceSamples) -> CoarseFloor | None:
    """The lowest of the large continuous lying surfaces; None without any."""
    xyz = samples.xyz_m.astype(np.float64)
    if len(xyz) == 0:
        return None
    near = (np.abs(xyz[:, :2] - np.median(xyz[:, :2], axis=0)) <= EXTENT_MAX_M).all(axis=1)
    xyz, area = xyz[near], samples.area_m2[near].astype(np.float64)
    cells = np.floor(xyz[:, :2] / COLUMN_M).astype(np.int64)
    low = cells.min(axis=0)
    width, height = (cells.max(axis=0) - low + 1).tolist()
    column = (cells[:, 1] - low[1]) * width + cells[:, 0] - low[0]
    order = np.lexsort((xyz[:, 2], column))
    starts, layer_z, coverage = _extract_layers(column[order], xyz[order, 2], area[order], width * height)
    if len(layer_z) == 0:
        return None
    grid = np.full((height, width), np.nan)
    chosen = _choose_surface(starts, layer_z, coverage, height, width)
    grid.reshape(-1)[_columns_of(starts)[chosen]] = layer_z[chosen]
    grid[_rises_above_neighbours(grid)] = np.nan
    frame = GridFrame(origin_x_m=float(low[0]) * COLUMN_M, origin_y_m=float(low[1]) * COLUMN_M, resolution_m=COLUMN_M)
    covered = float(np.minimum(coverage[chosen], 1.0).sum()) * COLUMN_M**2
    return CoarseFloor(frame=frame, height_m=grid, area_m2=covered)


def _columns_of(starts: Int64Array) -> Int64Array:
    """The column of each layer."""
    return np.repeat(np.arange(len(starts) - 1), np.diff(starts))


@kernel_with_cache
def _extract_layers(
    column: Int64Array, z: Float64Array, area: Float64Array, column_count: int
) -> tuple[Int64Array, Float64Array, Float64Array]:
    """Layers of every column, from samples sorted by column and height.

    Returns:
        First layer of each column (column_count + 1,), heights [m] and coverages of the layers.
    """
    starts = np.zeros(column_count + 1, np.int64)
    heights = np.empty(len(z), np.float64)
    coverages = np.empty(len(z), np.float64)
    count, i = 0, 0
    for c in range(column_count):
        starts[c] = count
        first = i
        while i < len(z) and column[i] == c:
            i += 1
        if i == first:
            continue
        bins = int((z[i - 1] - z[first]) / BIN_M) + 1
        mass = np.zeros(bins + 4)
        moment = np.zeros(bins + 4)
        for n in range(first, i):
            b = 2 + int((z[n] - z[first]) / BIN_M)
            mass[b] += area[n]
            moment[b] += area[n] * z[n]
        summed = np.zeros(bins + 4)
        for b in range(1, bins + 3):
            summed[b] = mass[b - 1] + mass[b] + mass[b + 1]
        last = -10
        for b in range(2, bins + 2):
            peak = summed[b] >= summed[b - 1] and summed[b] >= summed[b + 1]
            if peak and b - last > 2 and summed[b] >= COVERAGE_MIN * COLUMN_M * COLUMN_M:
                heights[count] = (moment[b - 1] + moment[b] + moment[b + 1]) / summed[b]
                coverages[count] = summed[b] / (COLUMN_M * COLUMN_M)
                count += 1
                last = b
    starts[column_count] = count
    return starts, heights[:count].copy(), coverages[:count].copy()


def _choose_surface(
    starts: Int64Array,
    layer_z: Float64Array,
    coverage: Float64Array,
    height: int,
    width: int,
) -> Int64Array:
    """Indices of the floor's layers, at most one per column."""
    group = _join_layers(starts, layer_z, height, width)
    solid = np.minimum(coverage, 1.0)
    sizes = np.bincount(group, weights=solid)
    means = np.bincount(group, weights=solid * layer_z) / np.where(sizes > 0, sizes, 1.0)
    large = np.nonzero(sizes >= SIZE_RATIO_MIN * sizes.max())[0]
    floor = large[np.argmin(means[large])]
    members = np.nonzero(group == floor)[0]
    columns = _columns_of(starts)
    alone = members[np.bincount(columns[members], minlength=height * width)[columns[members]] == 1]
    seeds = alone if len(alone) else members
    seed = seeds[np.argmin(np.abs(layer_z[seeds] - np.median(layer_z[seeds])))]
    return _grow(starts, layer_z, group, int(seed), height, width)


@kernel_with_cache
def _join_layers(starts: Int64Array, layer_z: Float64Array, height: int, width: int) -> Int64Array:
    """The connected surface of each layer: the smallest index of its layers."""
    parent = np.arange(len(layer_z))
    for c in range(height * width):
        row, col = c // width, c % width
        for o in range(len(_OFFSETS)):
            r, q = row + _OFFSETS[o, 0], col + _OFFSETS[o, 1]
            if r < row or (r == row and q < col) or r >= height or q < 0 or q >= width:
                continue
            d = r * width + q
            for a in range(starts[c], starts[c + 1]):
                for b in range(starts[d], starts[d + 1]):
                    if abs(layer_z[a] - layer_z[b]) > _TOLERANCES_M[o]:
                        continue
                    root_a, root_b = a, b
                    while parent[root_a] != root_a:
                        parent[root_a] = parent[parent[root_a]]
                        root_a = parent[root_a]
                    while parent[root_b] != root_b:
                        parent[root_b] = parent[parent[root_b]]
                        root_b = parent[root_b]
                    parent[max(root_a, root_b)] = min(root_a, root_b)
    for n in range(len(parent)):
        parent[n] = parent[parent[n]]
    return parent


@kernel_with_cache
def _grow(
    starts: Int64Array,
    layer_z: Float64Array,
    group: Int64Array,
    seed: int,
    height: int,
    width: int,
) -> Int64Array:
    """One layer per column, grown from a seed over the smallest steps first, so that shrubs and furniture come last."""
    column_count = height * width
    taken = np.full(column_count, -1, np.int64)
    owner = np.searchsorted(starts, seed, side="right") - 1
    heap = [(0.0, owner, seed)]
    while len(heap) > 0:
        _, c, layer = heapq.heappop(heap)
        if taken[c] >= 0:
            continue
        taken[c] = layer
        row, col = c // width, c % width
        for o in range(len(_OFFSETS)):
            r, q = row + _OFFSETS[o, 0], col + _OFFSETS[o, 1]
            if r < 0 or r >= height or q < 0 or q >= width or taken[r * width + q] >= 0:
                continue
            d = r * width + q
            for b in range(starts[d], starts[d + 1]):
                step = abs(layer_z[layer] - layer_z[b])
                if group[b] == group[seed] and step <= _TOLERANCES_M[o]:
                    heapq.heappush(heap, (step + 0.02 * _DISTANCES_M[o], d, b))
    return taken[taken >= 0]


def _rises_above_neighbours(height_m: Float64Array) -> BoolArray:
    """Columns that differ from the median of their 5x5 neighbourhood by more than a step."""
    padded = np.pad(height_m, 2, constant_values=np.nan)
    windows = np.lib.stride_tricks.sliding_window_view(padded, (5, 5)).reshape(*height_m.shape, 25)
    known = np.isfinite(height_m)
    rises = np.zeros(height_m.shape, np.bool_)
    rises[known] = np.abs(height_m[known] - np.nanmedian(windows[known], axis=1)) > STEP_MAX_M
    return rises
