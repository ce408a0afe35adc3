"""Narrow passages of a map: doors, gaps and bottlenecks between wider places.

A flood from the widest places down to the narrowest: where two basins that are clearly wider meet, there is a passage,
and the first cell to meet is its middle. Source: Meyer, Topographic distance and watershed lines, Signal Processing 38
(1994), with a bound on the basins' dynamics.
"""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array, Int32Array, Int64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import GridFrame
from readygo.services.planner.humans.robot_task import Point


@dataclass(frozen=True, kw_only=True)
class Passage:
    """A narrow place that humans walk through."""

    middle_m: Point
    width_m: float
    """Twice the distance of its middle to the nearest obstacle [m]."""


def find_passages(
    clearance: Float64Array, frame: GridFrame, *, walkable_m: float, width_max_m: float, wider_m: float
) -> tuple[Passage, ...]:
    """The passages of a map, from the widest to the narrowest.

    Args:
        clearance: Distance to obstacles at cell centres [m], shape (H, W).
        frame: Where the cells lie.
        walkable_m: Cells with less are not walked on [m].
        width_max_m: Wider places are no passages [m].
        wider_m: Both sides of a passage get wider by at least this [m].
    """
    cells = np.flatnonzero(clearance > walkable_m)
    # Stable, so that equal clearances keep the order of their cells.
    order = cells[np.argsort(-clearance.ravel()[cells], kind="stable")]
    met = _meetings(clearance, order, 0.5 * wider_m)
    return tuple(
        Passage(middle_m=frame.centre_m(i, j), width_m=2.0 * float(clearance[i, j]))
        for i, j in met.tolist()
        if 2.0 * clearance[i, j] <= width_max_m
    )


@kernel_with_cache
def _root(parent: Int32Array, label: int) -> int:
    while parent[label] != label:
        parent[label] = parent[parent[label]]
        label = parent[label]
    return label


@kernel_with_cache
def _meetings(clearance: Float64Array, order: Int64Array, deeper_m: float) -> Int64Array:
    """Cells at which two deep basins meet first, shape (M, 2); further meetings beside them do not count."""
    height, width = clearance.shape
    label = np.zeros((height, width), np.int32)
    border = np.zeros((height, width), np.bool_)
    parent = np.zeros(len(order) + 1, np.int32)
    peak = np.zeros(len(order) + 1)
    found = np.empty((len(order), 2), np.int64)
    labels, count = 0, 0
    for cell in order:
        i, j = cell // width, cell % width
        here = clearance[i, j]
        best, meets, beside = 0, False, False
        for di in range(-1, 2):
            for dj in range(-1, 2):
                ii, jj = i + di, j + dj
                if ii < 0 or ii >= height or jj < 0 or jj >= width or label[ii, jj] == 0:
                    continue
                beside = beside or border[ii, jj]
                other = _root(parent, label[ii, jj])
                if best == 0 or best == other:
                    best = other
                    continue
                low, high = (best, other) if peak[best] < peak[other] else (other, best)
                if peak[low] - here >= deeper_m:
                    meets = True
                else:
                    parent[low] = high
                best = high
        if best == 0:
            labels += 1
            best = labels
            parent[best], peak[best] = best, here
        label[i, j] = best
        if meets:
            border[i, j] = True
            if not beside:
                found[count, 0], found[count, 1] = i, j
                count += 1
    return found[:count].copy()
