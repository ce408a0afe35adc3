"""One merged Gaussian in place of some."""

import numpy as np

from readygo.common.rasterizer.lod.clusters import make_clusters
from readygo.common.rasterizer.lod.cost import MergeRule
from readygo.common.rasterizer.lod.merge import merge_regions
from tests.common.rasterizer.lod.merging import merged_count, originals


def test_neighbours_merge_when_pixels_are_large_enough_to_hide_it() -> None:
    row = originals([(0.03 * k, 0.0, 0.0) for k in range(8)], 0.8)
    counts = [merged_count(row, 0.01, pixel_m) for pixel_m in (0.003, 0.03, 0.3, 3.0)]
    assert counts[0] == 8
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 1


def test_gaussians_that_other_joints_move_stay_apart() -> None:
    pair = originals([(0.0, 0.0, 0.0), (1e-4, 0.0, 0.0)], 0.5)
    skin = np.zeros((2, 24), dtype=np.float32)
    skin[0, 3] = skin[1, 4] = 1.0
    apart = pair._replace(skin=skin)
    label, counts = np.arange(2, dtype=np.int32), np.array([2])
    arguments = (np.array([0, 2]), counts, np.zeros(2, dtype=np.int64), np.ones(1))
    merge_regions(apart, label, *arguments, MergeRule(1.0, 1.0, 0.1, 0.5), 5, make_clusters(24))
    assert counts[0] == 2
    assert merged_count(pair, 1.0, 1.0) == 1
