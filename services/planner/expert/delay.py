"""How long humans hold the robot up: the heuristic of the search in space and time.

Values are computed backwards over time on a coarse grid around the robot, for a robot that can move in any direction
at once. They add to the static way to the goal what humans cost on top; infinite where every way out is closed.

Legend: cell (a, b) is row and column of the coarse grid, whose middle cell (half, half) is around the robot; S the
static way to the goal, N what humans cost per second, V_l the delay in layer l. From the last layer back, over the cell
itself and its eight neighbours n with moved = 0, cell or sqrt(2) cell:

    V_l = min over n of (V_l+1(n) + max(0, paid + S(n) - S)) + N layer_s,
    paid = (moved + max(moved, layer_s speed)) / 2.

`paid` is the cost of primitives: half by length, half by time.
"""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode.grid_search import UNITS_PER_CELL, UNREACHED
from readygo.common.kernels import kernel_with_cache
from readygo.services.planner.expert.records import CostGrid, HumansAhead

_CONTACT_COST = 100.0
"""Cost per second of touching a human; twice that where both centres meet."""
_DIAGONAL = 1.4142
"""Length of a step to a diagonal neighbour, in cells."""
_HALF_CELL = 0.4
"""The part of a cell's side by which a robot in the cell may be nearer to a human than its middle."""
LAYER_S = 0.25
"""Time between two layers, as near as steps come to it: in 0.25 s a robot of 1 m/s drives one cell of 0.25 m."""


class Delays(NamedTuple):
    """Delays on a coarse grid around the robot."""

    cell_m: float
    """Edge of coarse cells [m]; what the robot drives between two layers."""
    speed_mps: float
    """The robot's full speed [m/s]."""
    arrived_m: float
    """The robot may stay at no cost where it is this near to the goal [m]."""
    static_m: Float64Array
    """Memory for the ways to the goal without humans, shape (N, N)."""
    values_m: Float64Array
    """Metres at full speed, shape (L, N, N); layer l is the time of l * `layer_steps` steps."""
    layer_steps: int
    """Steps between two layers."""


@kernel_with_cache
def nearness_cost(squared: float, hard: float, width: float, weight: float) -> float:
    """Cost per second of being near a human.

    Args:
        squared: Squared distance of the centres [m2].
        hard: Distance of the centres that is contact [m].
        width: Free space beyond it that costs nothing [m].
        weight: Cost per second just outside of contact.
    """
    if squared >= (hard + width) * (hard + width):
        return 0.0
    distance = math.sqrt(squared)
    if distance < hard:
        # There is always a least evil: contact is costly, the deeper the more.
        return weight + _CONTACT_COST * (2.0 - distance / hard)
    # Falls with the square of the distance from the outer rim, from `weight` at contact to 0.
    nearness = 1.0 - (distance - hard) / width
    return weight * nearness * nearness


@kernel_with_cache
def delay_at(delays: Delays, centre: tuple[float, float, float], x: float, y: float, layer: int) -> float:
    """The delay of a robot at a place [m] in a layer; the grid is around a pose."""
    cell, _, _, _, values, _ = delays
    half = values.shape[1] // 2
    a, b = half + math.floor((y - centre[1]) / cell + 0.5), half + math.floor((x - centre[0]) / cell + 0.5)
    # Cells that a robot cannot reach by then are not filled.
    if layer >= len(values) - 1 or max(abs(a - half), abs(b - half)) > layer + 1:
        return 0.0
    return float(values[layer, a, b])


@kernel_with_cache
def fill_delays(grid: CostGrid, centre: tuple[float, float, float], humans: HumansAhead, out: Delays) -> None:
    """Fill the delays.

    Args:
        grid: Costs and ways to the goal.
        centre: Robot's pose, from the corner of the grid [m, m, rad].
        humans: Who is in the way.
        out: Its values are filled.
    """
    cell, speed, arrived, static, delays, layer_steps = out
    layers, n, _ = delays.shape
    half = n // 2
    _fill_static(grid, cell, centre, static)
    layer_s = layer_steps * humans.step_s
    for a in range(n):
        for b in range(n):
            delays[layers - 1, a, b] = 0.0 if static[a, b] < np.inf else np.inf
    near, best = np.empty((n, n)), np.empty(n)
    for layer in range(layers - 2, -1, -1):
        # A robot drives one cell per layer: no more of the grid can be reached by then.
        reach = min(half, layer + 1)
        low, high = half - reach, half + reach + 1
        near[low:high, low:high] = 0.0
        if layer > 0:
            _add_nearness(humans, layer * layer_steps - 1, cell, centre, (low, high), near)
        for a in range(low, high):
            here, there, sums = static[a, low:high], delays[layer, a, low:high], near[a, low:high]
            best[:] = np.inf
            for da in range(-1, 2):
                for db in range(-1, 2):
                    moved = 0.0 if da == 0 and db == 0 else (cell if da == 0 or db == 0 else _DIAGONAL * cell)
                    paid = 0.5 * moved + 0.5 * max(moved, layer_s * speed)
                    onward = static[a + da, low + db : high + db]
                    after = delays[layer + 1, a + da, low + db : high + db]
                    for b in range(len(here)):
                        best[b] = min(best[b], after[b] + max(0.0, paid + onward[b] - here[b]))
            for b in range(len(here)):
                there[b] = best[b] + sums[b] * layer_s
                if here[b] < arrived:
                    there[b] = 0.0
                if here[b] == np.inf:
                    there[b] = np.inf


@kernel_with_cache
def _fill_static(grid: CostGrid, cell: float, centre: tuple[float, float, float], static: Float64Array) -> None:
    """Fill the smallest way to the goal in each coarse cell [m]; infinite where there is none."""
    factor, to_goal, resolution = grid
    n = len(static)
    half, unit = n // 2, resolution / UNITS_PER_CELL
    height, width = factor.shape
    least = np.empty(width, np.int32)
    left, right = centre[0] + (-half - 0.5) * cell, centre[0] + (n - half) * cell
    first = max(0, math.floor(left / resolution))
    last = min(width, math.ceil(right / resolution))
    for a in range(n):
        y = centre[1] + (a - half - 0.5) * cell
        least[:] = UNREACHED
        for i in range(max(0, math.floor(y / resolution)), min(height, math.ceil((y + cell) / resolution))):
            costs, ways, row = factor[i, first:last], to_goal[i, first:last], least[first:last]
            for j in range(len(row)):
                row[j] = min(row[j], ways[j] if costs[j] > 0 else np.int32(UNREACHED))
        for b in range(n):
            x = centre[0] + (b - half - 0.5) * cell
            best = UNREACHED
            for j in range(max(0, math.floor(x / resolution)), min(width, math.ceil((x + cell) / resolution))):
                best = min(best, least[j])
            static[a, b] = best * unit if best < UNREACHED else np.inf


@kernel_with_cache
def _add_nearness(
    humans: HumansAhead,
    step: int,
    cell: float,
    centre: tuple[float, float, float],
    span: tuple[int, int],
    near: Float64Array,
) -> None:
    """Add what humans cost per second to the coarse cells of a span of rows and columns."""
    expected, chances, hard, widths, weight, _ = humans
    half = len(near) // 2
    row = min(step, expected.shape[1] - 1)
    for m in range(len(expected)):
        ex, ey = expected[m, row, 0], expected[m, row, 1]
        # The robot may be anywhere in the cell.
        contact, width = hard - _HALF_CELL * cell, widths[m, row] + _HALF_CELL * cell
        away = contact + width + cell
        a_first, a_last = math.floor((ey - away - centre[1]) / cell) + half, math.ceil((ey + away - centre[1]) / cell)
        b_first, b_last = math.floor((ex - away - centre[0]) / cell) + half, math.ceil((ex + away - centre[0]) / cell)
        for a in range(max(span[0], a_first), min(span[1], a_last + half + 1)):
            for b in range(max(span[0], b_first), min(span[1], b_last + half + 1)):
                x, y = centre[0] + (b - half) * cell, centre[1] + (a - half) * cell
                dx, dy = ex - x, ey - y
                squared = dx * dx + dy * dy
                near[a, b] += chances[m] * nearness_cost(squared, contact, width, weight)
