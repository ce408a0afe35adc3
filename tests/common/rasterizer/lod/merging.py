"""Small sets of Gaussians, and how many of them are left after merging."""

import numpy as np

from readygo.common.rasterizer.lod.clusters import Originals, make_clusters
from readygo.common.rasterizer.lod.cost import MergeRule
from readygo.common.rasterizer.lod.merge import merge_regions

SIGMA_M = 0.02


def originals(means: list[tuple[float, float, float]], opacity: float, colours: list[float] | None = None) -> Originals:
    count = len(means)
    return Originals(
        mean_m=np.array(means, dtype=np.float64),
        covariance_m2=np.tile([SIGMA_M**2, 0.0, 0.0, SIGMA_M**2, 0.0, SIGMA_M**2], (count, 1)),
        opacity=np.full(count, opacity),
        colour=np.repeat(np.array(colours or [0.5] * count)[:, None], 3, axis=1),
        skin=np.zeros((count, 0), dtype=np.float32),
    )


def merged_count(gaussians: Originals, tolerance: float, pixel_m: float) -> int:
    count = len(gaussians.opacity)
    label, counts = np.arange(count, dtype=np.int32), np.array([count])
    wait, leeway = np.zeros(count, dtype=np.int64), np.ones(1)
    rule = MergeRule(pixel_m, tolerance, 0.1, 0.5)
    first = np.array([0, count])
    merge_regions(gaussians, label, first, counts, wait, leeway, rule, 5, make_clusters(0))
    assert sorted(set(label.tolist())) == list(range(counts[0]))
    return int(counts[0])
