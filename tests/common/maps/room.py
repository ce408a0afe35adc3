"""Small rooms made of flat Gaussians."""

import numpy as np

from readygo.common.frames import quat_from_matrix
from readygo.common.gaussians import GaussianCloud, concatenate

SPACING_M = 0.07


def sheet(corner_m, edge_a_m, edge_b_m, *, opacity=0.9, spacing_m=SPACING_M):
    """A rectangle of flat Gaussians that overlap."""
    corner, a, b = (np.asarray(v, dtype=np.float64) for v in (corner_m, edge_a_m, edge_b_m))
    na, nb = (max(1, round(np.linalg.norm(v) / spacing_m)) for v in (a, b))
    u, v = np.meshgrid((np.arange(na) + 0.5) / na, (np.arange(nb) + 0.5) / nb)
    means = corner + u.reshape(-1, 1) * a + v.reshape(-1, 1) * b
    x, y = a / np.linalg.norm(a), b / np.linalg.norm(b)
    q = quat_from_matrix(np.stack([x, y, np.cross(x, y)], axis=1))
    count = len(means)
    return GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=np.tile(q, (count, 1)).astype(np.float32),
        scales_m=np.tile(np.float32([0.6 * spacing_m, 0.6 * spacing_m, 0.003]), (count, 1)),
        opacities=np.full(count, opacity, np.float32),
        sh=np.zeros((count, 1, 3), np.float32),
    )


def box(low_m, high_m):
    """The six sides of a box."""
    low, high = np.asarray(low_m, dtype=np.float64), np.asarray(high_m, dtype=np.float64)
    edges = np.diag(high - low)
    sides = []
    for axis in range(3):
        a, b = edges[(axis + 1) % 3], edges[(axis + 2) % 3]
        sides += [sheet(low, a, b), sheet(low + edges[axis], a, b)]
    return concatenate(sides)


def room(width_m=6.0, depth_m=5.0, *, height_m=2.5, tilt=0.0):
    """Floor, four walls and a ceiling with a corner at (0, 0, 0); the floor rises by `tilt` metres per metre of x."""
    x, y, z = np.array([width_m, 0, tilt * width_m]), np.array([0, depth_m, 0]), np.array([0, 0, height_m])
    zero = np.zeros(3)
    return concatenate(
        [sheet(zero, x, y), sheet(z, x, y), sheet(zero, x, z), sheet(y, x, z), sheet(zero, y, z), sheet(x, y, z)]
    )
