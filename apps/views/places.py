"""Viewpoints: places spread over the ground that a robot can reach."""

import math

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.maps import GridFrame

HEADINGS = 4
"""Number of views from a place, a quarter turn apart."""
_CELLS_MAX = 20_000
_ROUNDS = 4


def poses_to_look_from(reachable: BoolArray, frame: GridFrame, count: int) -> Float64Array:
    """Poses of sample views, `HEADINGS` per place.

    Args:
        reachable: True for cells to stand on, shape (H, W), at least one.
        frame: Grid of the cells.
        count: Number of places; fewer if there are fewer cells.

    Returns:
        x, y [m], yaw [rad], shape (places, HEADINGS, 3).
    """
    places = spread_places(reachable, frame, count)[:, None].repeat(HEADINGS, axis=1)
    yaws = np.arange(HEADINGS) * (math.tau / HEADINGS)
    return np.concatenate([places, np.broadcast_to(yaws[:, None], (*places.shape[:2], 1))], axis=-1)


def spread_places(reachable: BoolArray, frame: GridFrame, count: int) -> Float64Array:
    """Centres of cells that represent about equal areas [m], shape (places, 2); deterministic for a map.

    The places start far from each other; each then moves to the centre of the cells nearest to it (Lloyd, 1982).
    """
    cells = np.argwhere(reachable)
    cells = cells[:: -(-len(cells) // _CELLS_MAX)]
    chosen = [int(np.argmin(_square_distances(cells, cells.mean(axis=0))))]
    nearest = _square_distances(cells, cells[chosen[0]])
    while len(chosen) < min(count, len(cells)):
        chosen.append(int(np.argmax(nearest)))
        nearest = np.minimum(nearest, _square_distances(cells, cells[chosen[-1]]))
    for _ in range(_ROUNDS):
        owner = np.argmin([_square_distances(cells, cells[k]) for k in chosen], axis=0)
        middles = (cells[owner == k].mean(axis=0) for k in range(len(chosen)))
        chosen = [int(np.argmin(_square_distances(cells, middle))) for middle in middles]
    # From the largest y down, as people read a map.
    rows = sorted({tuple(cells[k]) for k in chosen}, reverse=True)
    return np.column_stack(frame.centre_m(*np.array(rows).T))


def _square_distances(cells: Int64Array, cell: Float64Array) -> Float64Array:
    offset: Float64Array = (cells - cell).astype(np.float64)
    squared: Float64Array = offset[:, 0] ** 2 + offset[:, 1] ** 2
    return squared
