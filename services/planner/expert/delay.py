"""How long humans hold the robot up: the heuristic of the search in space and time.

Values are computed backwards over time on a coarse grid around the robot, for a robot that can move in any direction
at once. They add to the static way to the goal what humans cost on top; infinite where every way out is closed.
"""

import math

import numpy as np
import numpy.typing as npt

from readygo.common.episode.grid_search import UNITS_PER_CELL, UNREACHED
from readygo.common.kernels import compiled

Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
UInt8Array = npt.NDArray[np.uint8]

People = tuple[Float64Array, Float64Array, float, Float64Array, float]
"""Positions after 1, 2, ... steps [m], shape (M, T, 2); chances, shape (M,); contact distance [m]; widths [m], shape
(M, T); weight. See `TimedHumans`."""

_CONTACT_COST = 100.0
LAYER_STEPS = 5
"""Simulation steps between two layers: in 0.25 s a robot of 1 m/s drives one cell of 0.25 m."""


@compiled
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
        # There is always a least evil: contact is dear, the deeper the dearer.
        return weight + _CONTACT_COST * (2.0 - distance / hard)
    nearness = 1.0 - (distance - hard) / width
    return weight * nearness * nearness


@compiled
def fill_delays(
    factor: UInt8Array,
    to_goal: Int32Array,
    resolution: float,
    cell: float,
    centre: tuple[float, float],
    humans: People,
    step_s: float,
    speed: float,
    arrived: float,
    static: Float64Array,
    delays: Float64Array,
) -> None:
    """Fill the delays.

    Args:
        factor: Cost factors of the fine cells, shape (H, W).
        to_goal: Way to the goal, UNITS_PER_CELL a fine cell, shape (H, W).
        resolution: Edge of fine cells [m].
        cell: Edge of coarse cells [m]; what the robot drives between two layers.
        centre: Robot, from the corner of the fine grid [m].
        humans: As in `primitive_cost`.
        step_s: Time of a simulation step [s].
        speed: Full speed [m/s].
        arrived: Whoever is this near to the goal may stay there at no cost [m].
        static: Memory, shape (N, N).
        delays: Filled with metres at full speed, shape (L, N, N); layer l is the time of l * LAYER_STEPS steps.
    """
    layers, n, _ = delays.shape
    half = n // 2
    _fill_static(factor, to_goal, resolution, cell, centre, static)
    layer_s = LAYER_STEPS * step_s
    for a in range(n):
        for b in range(n):
            delays[layers - 1, a, b] = 0.0 if static[a, b] < np.inf else np.inf
    near, best = np.empty((n, n)), np.empty(n)
    for layer in range(layers - 2, -1, -1):
        reach = min(half, layer + 1)
        low, high = half - reach, half + reach + 1
        near[low:high, low:high] = 0.0
        if layer > 0:
            _add_nearness(humans, layer * LAYER_STEPS - 1, cell, centre, (low, high), near)
        for a in range(low, high):
            here, there, sums = static[a, low:high], delays[layer, a, low:high], near[a, low:high]
            best[:] = np.inf
            for da in range(-1, 2):
                for db in range(-1, 2):
                    moved = 0.0 if da == 0 and db == 0 else (cell if da == 0 or db == 0 else 1.4142 * cell)
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


@compiled
def _fill_static(
    factor: UInt8Array,
    to_goal: Int32Array,
    resolution: float,
    cell: float,
    centre: tuple[float, float],
    static: Float64Array,
) -> None:
    """Fill the smallest way to the goal in each coarse cell [m]; infinite where there is none."""
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


@compiled
def _add_nearness(
    humans: People,
    step: int,
    cell: float,
    centre: tuple[float, float],
    span: tuple[int, int],
    near: Float64Array,
) -> None:
    """Add what humans cost per second to the coarse cells of a span of rows and columns."""
    expected, chances, hard, widths, weight = humans
    half = len(near) // 2
    row = min(step, expected.shape[1] - 1)
    for m in range(len(expected)):
        ex, ey = expected[m, row, 0], expected[m, row, 1]
        # The robot may be anywhere in the cell.
        contact, width = hard - 0.4 * cell, widths[m, row] + 0.4 * cell
        away = contact + width + cell
        a_first, a_last = math.floor((ey - away - centre[1]) / cell) + half, math.ceil((ey + away - centre[1]) / cell)
        b_first, b_last = math.floor((ex - away - centre[0]) / cell) + half, math.ceil((ex + away - centre[0]) / cell)
        for a in range(max(span[0], a_first), min(span[1], a_last + half + 1)):
            for b in range(max(span[0], b_first), min(span[1], b_last + half + 1)):
                x, y = centre[0] + (b - half) * cell, centre[1] + (a - half) * cell
                dx, dy = ex - x, ey - y
                squared = dx * dx + dy * dy
                near[a, b] += chances[m] * nearness_cost(squared, contact, width, weight)
