"""Which images are compared with each other."""

import math
from collections.abc import Mapping

import numpy as np

from readygo.common.arrays import Float64Array

_FAR = 40
"""So many images, spread over a video, are compared each with each, so that ways that meet again are found."""
_NEAR_COS = math.cos(math.radians(60.0))
"""Views of 360-degree images that follow each other are compared within this angle, as the camera hardly turns."""
_SAME_RING = 1e-3


def image_pairs(count: int, *, sequential: bool, overlap: int) -> list[tuple[int, int]]:
    """Pairs (i, j), i < j, of images by their order.

    Photos are compared each with each. An image of a video is compared with the `overlap` images after it, with those
    2, 4, 8, ... times as far as that, and one of every few with all others of these.
    """
    if not sequential:
        return [(i, j) for i in range(count) for j in range(i + 1, count)]
    reach = [overlap * 2**power for power in range(1, 5)]
    pairs = {(i, i + step) for step in (*range(1, overlap + 1), *reach) for i in range(count - step)}
    every = max(1, -(-count // _FAR))
    pairs |= {(i, j) for i in range(0, count, every) for j in range(i + every, count, every)}
    return sorted(pairs)


def view_pairs(rig: Mapping[str, Float64Array], *, near: bool) -> list[tuple[str, str]]:
    """Which views of one 360-degree image are compared with which of another.

    Args:
        rig: Rotations `R_panorama_view` by view, shape (3, 3).
        near: Whether the images follow each other: then views in similar directions are; else all of equal pitch.
    """
    forward = {name: R[:, 2] for name, R in rig.items()}
    if near:
        return [(a, b) for a in rig for b in rig if float(forward[a] @ forward[b]) > _NEAR_COS]
    return [(a, b) for a in rig for b in rig if np.abs(forward[a][1] - forward[b][1]) < _SAME_RING]
