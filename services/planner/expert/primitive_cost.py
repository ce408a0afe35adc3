"""What walls and humans add to the cost of a timed primitive.

Legend: a primitive from (x, y) with the heading (c, s) = (cos, sin) is, at its row (rx, ry), at the point

    p = (x + c rx - s ry, y + s rx + c ry).

It is checked after every `CHECK_STEPS` steps: check n at row (n + 1) `CHECK_STEPS` - 1. Row k of `humans.expected_m` is
where they will be k + 1 steps from now.
"""

import math

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, UInt8Array
from readygo.common.episode.collision import disc_meets_cells
from readygo.common.episode.grid_search import FREE
from readygo.common.kernels import kernel_with_cache
from readygo.services.planner.expert.delay import nearness_cost
from readygo.services.planner.expert.records import HumansAhead, Obstacles

CHECK_STEPS = 2
"""Steps between two checks of a primitive against walls and humans."""
_ROUNDING_M = 1e-6
HALF_DIAGONAL = 0.71
"""Half the diagonal of a cell, in cells: how far a point of a cell may be from its centre."""


@kernel_with_cache
def check_reaches(rows: Float64Array) -> Float64Array:
    """Farthest that a primitive leads until each of its checks [m], from the rows of all, shape (Q, K, 5)."""
    reaches = np.zeros(rows.shape[1] // CHECK_STEPS)
    for q in range(len(rows)):
        for n in range(len(reaches)):
            row = rows[q, (n + 1) * CHECK_STEPS - 1]
            reaches[n] = max(reaches[n], math.sqrt(row[0] * row[0] + row[1] * row[1]))
    return reaches


@kernel_with_cache
def find_near(
    humans: HumansAhead,
    place: tuple[float, float],
    step: int,
    reaches: Float64Array,
    near: Int32Array,
    near_counts: Int32Array,
) -> None:
    """Find the humans that a primitive from a place may come near to.

    Args:
        humans: Who is in the way.
        place: Where the primitive starts [m].
        step: When it starts.
        reaches: See `check_reaches`, shape (N,).
        near: Filled with indices of humans for each check, shape (N, M).
        near_counts: Filled with how many these are, shape (N,).
    """
    expected, _, contact, widths, _, _ = humans
    for n in range(len(reaches)):
        row = min(step + (n + 1) * CHECK_STEPS - 1, expected.shape[1] - 1)
        count = 0
        for m in range(len(expected)):
            dx, dy = expected[m, row, 0] - place[0], expected[m, row, 1] - place[1]
            far = contact + widths[m, row] + reaches[n] + _ROUNDING_M
            if dx * dx + dy * dy < far * far:
                near[n, count] = m
                count += 1
        near_counts[n] = count


@kernel_with_cache
def wall_cost(
    factor: UInt8Array,
    obstacles: Obstacles,
    radius: float,
    place: tuple[float, float],
    heading: tuple[float, float],
    rows: Float64Array,
    length: float,
) -> float:
    """What walls add to the cost of a primitive, by cosine and sine of its heading; negative if they block it.

    Places count from the corner of the map.
    """
    height, width = factor.shape
    occupied, clearance, _, _, resolution = obstacles
    free = radius + HALF_DIAGONAL * resolution
    total, checks = 0, 0
    for k in range(CHECK_STEPS - 1, len(rows), CHECK_STEPS):
        px = place[0] + heading[0] * rows[k, 0] - heading[1] * rows[k, 1]
        py = place[1] + heading[1] * rows[k, 0] + heading[0] * rows[k, 1]
        if px < 0.0 or py < 0.0:
            return -1.0
        i, j = int(py / resolution), int(px / resolution)
        if i >= height or j >= width or factor[i, j] == 0:
            return -1.0
        # Cells with more clearance than this need no look at their surroundings.
        if clearance[i, j] <= free and disc_meets_cells(occupied, 0.0, 0.0, resolution, px, py, radius):
            return -1.0
        total += factor[i, j] - FREE
        checks += 1
    # Length times (mean cost factor - 1).
    return length * total / (FREE * checks)


@kernel_with_cache
def human_cost(
    place: tuple[float, float],
    heading: tuple[float, float],
    rows: Float64Array,
    humans: HumansAhead,
    step: int,
    near: Int32Array,
    near_counts: Int32Array,
) -> float:
    """What humans add to the cost of a primitive that starts at a step; see `find_near`."""
    expected, chances, contact, widths, weight, step_s = humans
    extra = 0.0
    for n in range(len(near_counts)):
        if near_counts[n] == 0:
            continue
        k = (n + 1) * CHECK_STEPS - 1
        px = place[0] + heading[0] * rows[k, 0] - heading[1] * rows[k, 1]
        py = place[1] + heading[1] * rows[k, 0] + heading[0] * rows[k, 1]
        row = min(step + k, expected.shape[1] - 1)
        for index in range(near_counts[n]):
            m = near[n, index]
            dx, dy = expected[m, row, 0] - px, expected[m, row, 1] - py
            squared = dx * dx + dy * dy
            extra += chances[m] * nearness_cost(squared, contact, widths[m, row], weight) * CHECK_STEPS * step_s
    return extra
