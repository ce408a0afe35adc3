"""Clouds and trees that the tests of levels of detail share."""

import math
from collections.abc import Iterator

import numpy as np

from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.lod.tree import ChunkTree


def room(count: int, *, coefficients: int = 1) -> GaussianCloud:
    """Painted walls, floor and ceiling of a room of 8 x 8 x 3 m, of small flat Gaussians."""
    rng = np.random.default_rng(2)
    side = rng.integers(0, 3, size=count)
    means = rng.uniform((-4.0, -4.0, 0.0), (4.0, 4.0, 3.0), size=(count, 3))
    end = rng.integers(0, 2, size=count)
    low, high = np.array([-4.0, -4.0, 0.0]), np.array([4.0, 4.0, 3.0])
    rows = np.arange(count)
    means[rows, side] = np.where(end == 0, low[side], high[side])
    scales = np.exp(rng.uniform(math.log(0.02), math.log(0.1), size=(count, 3)))
    scales[rows, side] = 0.002
    quats = np.zeros((count, 4))
    quats[:, 0] = 1.0
    sh = 0.05 * rng.normal(size=(count, coefficients, 3))
    sh[:, 0] = 0.8 * np.sin(3.0 * means + np.array([0.0, 1.0, 2.0]) + end[:, None]) + 0.1 * rng.normal(size=(count, 3))
    return GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=quats.astype(np.float32),
        scales_m=scales.astype(np.float32),
        opacities=rng.uniform(0.3, 1.0, size=count).astype(np.float32),
        sh=sh.astype(np.float32),
    )


def leaves_of(tree: ChunkTree) -> list[tuple[int, int]]:
    """First and last leaf, by their place among the leaves, below each node."""
    is_leaf = tree.skip == np.arange(len(tree.skip)) + 1
    starts = np.concatenate([[0], np.cumsum(is_leaf)])
    return [(int(starts[k]), int(starts[tree.skip[k]])) for k in range(len(tree.skip))]


def cut_at(tree: ChunkTree, fine_enough: np.ndarray) -> Iterator[int]:
    """The first nodes from the roots on that are fine enough, or leaves."""
    k = 0
    while k < len(tree.skip):
        if fine_enough[k] or tree.skip[k] == k + 1:
            yield k
            k = int(tree.skip[k])
        else:
            k += 1


def psnr_db(a: np.ndarray, b: np.ndarray) -> float:
    """Of images of bytes."""
    return 10 * math.log10(255**2 / max(float(((a.astype(np.float64) - b) ** 2).mean()), 1e-6))
