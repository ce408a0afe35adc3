"""How long humans hold the robot up: the heuristic of the search in space and time.

Values are computed backwards over time on a coarse grid around the robot, for a robot that can move in any direction
at once. They add to the static way to the goal what humans cost on top; infinite where every way out is closed.
"""

import math

import numpy as np
import numpy.typing as npt
from numba import njit

from common.episode.grid_search import UNITS_PER_CELL, UNREACHED

Float64Array = npt.NDArray[np.float64]
Int32Array = npt.NDArray[np.int32]
UInt8Array = npt.NDArray[np.uint8]

People = tuple[Float64Array, Float64Array, float, Float64Array, float]
"""Positions after 1, 2, ... steps [m], shape (M, T, 2); chances, shape (M,); contact distance [m]; widths [m], shape
(M, T); weight. See `TimedHumans`."""

_CONTACT_COST = 100.0
LAYER_STEPS = 5
"""Simulation steps between two layers: in 0.25 s a robot of 1 m/s drives one cell of 0.25 m."""


@njit(cache=True)
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


@njit(cache=True)
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
    unit = resolution / UNITS_PER_CELL
    height, width = factor.shape
    for a in range(n):
        for b in range(n):
            y, x = centre[1] + (a - half - 0.5) * cell, centre[0] + (b - half - 0.5) * cell
            best = np.inf
            for i in range(max(0, math.floor(y / resolution)), min(height, math.ceil((y + cell) / resolution))):
                for j in range(max(0, math.floor(x / resolution)), min(width, math.ceil((x + cell) / resolution))):
                    if factor[i, j] > 0 and to_goal[i, j] < UNREACHED:
                        best = min(best, to_goal[i, j] * unit)
            static[a, b] = best
    expected, chances, hard, widths, weight = humans
    layer_s = LAYER_STEPS * step_s
    for a in range(n):
        for b in range(n):
            delays[layers - 1, a, b] = 0.0 if static[a, b] < np.inf else np.inf
    for layer in range(layers - 2, -1, -1):
        reach = min(half, layer + 1)
        for a in range(half - reach, half + reach + 1):
            for b in range(half - reach, half + reach + 1):
                here = static[a, b]
                delays[layer, a, b] = np.inf
                if here == np.inf:
                    continue
                if here < arrived:
                    delays[layer, a, b] = 0.0
                    continue
                near = 0.0
                if layer > 0:
                    row = min(layer * LAYER_STEPS - 1, expected.shape[1] - 1)
                    x, y = centre[0] + (b - half) * cell, centre[1] + (a - half) * cell
                    for m in range(len(expected)):
                        dx, dy = expected[m, row, 0] - x, expected[m, row, 1] - y
                        # The robot may be anywhere in the cell.
                        squared = dx * dx + dy * dy
                        near += chances[m] * nearness_cost(
                            squared, hard - 0.4 * cell, widths[m, row] + 0.4 * cell, weight
                        )
                best = np.inf
                for da in range(-1, 2):
                    for db in range(-1, 2):
                        aa, bb = a + da, b + db
                        if aa < 0 or bb < 0 or aa >= n or bb >= n:
                            continue
                        after = delays[layer + 1, aa, bb]
                        if after >= best:
                            continue
                        moved = 0.0 if da == 0 and db == 0 else (cell if da == 0 or db == 0 else 1.4142 * cell)
                        paid = 0.5 * moved + 0.5 * max(moved, layer_s * speed)
                        best = min(best, after + max(0.0, paid + static[aa, bb] - here))
                delays[layer, a, b] = best + near * layer_s
