"""A tree of seven nodes: a root with two children, each of which has two leaves."""

import numpy as np
import pytest

from readygo.common.rasterizer.cpu.lod_cull import Cut, cull_human_tree, cull_tree
from readygo.common.rasterizer.cpu.view import VisibleChunks, make_view

SKIP = np.array([7, 4, 3, 4, 7, 6, 7])
PIXEL_M = np.array([0.4, 0.1, 0.0, 0.0, 0.1, 0.0, 0.0])
X_M = np.array([0.0, -1.0, -1.5, -0.5, 1.0, 0.5, 1.5])
HALF_M = np.float32([2.0, 1.0, 0.5, 0.5, 1.0, 0.5, 0.5])
K = np.array([[50.0, 0.0, 48.0], [0.0, 50.0, 32.0], [0.0, 0.0, 1.0]])


def half_sizes() -> np.ndarray:
    return np.stack([HALF_M, np.full(7, 0.1), np.full(7, 0.1)], axis=1).astype(np.float32)


def drawn(z_m: float, coarseness: float, *, x_m: float = 0.0, human: bool = False) -> list[int]:
    """Nodes of the tree, as a scene or as the chunks of an avatar, that is `z_m` ahead."""
    view, reach_m = make_view(np.eye(4), K, 64, 96), np.full(7, 0.01, np.float32)
    out = VisibleChunks(np.empty(7, np.int64), np.empty(7), np.empty(7, np.int64), np.empty((2, 3)))
    cut = Cut(SKIP, PIXEL_M, coarseness)
    centre_m = np.stack([X_M + x_m, np.zeros(7), np.full(7, z_m)], axis=1)
    if not human:
        count = cull_tree(view, centre_m, half_sizes(), reach_m, cut, out)
        return out.number[:count].tolist()
    A_CS = np.tile(np.eye(3, 4, dtype=np.float32), (24, 1, 1))
    A_CS[5, :, 3] = (x_m, 0.0, z_m)
    centre_m -= (x_m, 0.0, z_m)
    boxes = np.arange(8), np.full(7, 5), centre_m.astype(np.float32), half_sizes(), reach_m
    count = cull_human_tree(view, np.zeros(5, dtype=np.float32), A_CS, *boxes, cut, out)
    return out.number[:count].tolist()


@pytest.mark.parametrize("human", [False, True])
@pytest.mark.parametrize(
    ("z_m", "coarseness", "nodes"),
    [(4.0, 1.0, [2, 3, 5, 6]), (6.0, 1.0, [1, 4]), (19.0, 1.0, [1, 4]), (21.0, 1.0, [0]), (4.0, 2.0, [1, 4])],
)
def test_nodes_are_drawn_as_soon_as_pixels_at_their_depth_are_large_enough(
    z_m: float, coarseness: float, nodes: list[int], human: bool
) -> None:
    assert drawn(z_m, coarseness, human=human) == nodes


@pytest.mark.parametrize("human", [False, True])
def test_coarseness_0_draws_the_leaves_however_far(human: bool) -> None:
    assert drawn(300.0, 0.0, human=human) == [2, 3, 5, 6]


@pytest.mark.parametrize("human", [False, True])
def test_what_is_below_an_invisible_node_is_left_out(human: bool) -> None:
    assert drawn(4.0, 1.0, x_m=4.7, human=human) == [2, 3]
    assert drawn(-4.0, 1.0, human=human) == []
