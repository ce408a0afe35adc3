"""One merged Gaussian in place of some."""

import numpy as np

from readygo.common.rasterizer.lod.clusters import NEIGHBOURS, make_clusters
from readygo.common.rasterizer.lod.cost import MergeRule
from readygo.common.rasterizer.lod.merge import _find_neighbours, _pair_up, _renumber, _set_waits, merge_regions
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


def test_neighbours_are_the_nearest_clusters_nearest_first() -> None:
    clusters = make_clusters(0)
    clusters.mean_m[:30] = np.random.default_rng(1).normal(size=(30, 3)) * [3.0, 0.4, 1.0]
    _find_neighbours.py_func(30, np.zeros(30, dtype=np.int64), clusters)
    distance2 = ((clusters.mean_m[:30, None] - clusters.mean_m[None, :30]) ** 2).sum(axis=2)
    np.fill_diagonal(distance2, np.inf)
    np.testing.assert_array_equal(clusters.near[:30], np.argsort(distance2, axis=1)[:, :NEIGHBOURS])
    np.testing.assert_allclose(clusters.distance2[:30], np.sort(distance2, axis=1)[:, :NEIGHBOURS])
    _find_neighbours.py_func(3, np.zeros(3, dtype=np.int64), clusters)
    assert (clusters.near[:3, 2:] == -1).all()
    assert (clusters.near[:3, :2] >= 0).all()


def test_equally_near_neighbours_are_in_the_order_of_their_numbers() -> None:
    clusters = make_clusters(0)
    clusters.mean_m[:27] = np.stack(np.meshgrid([0.0, 1.0, 2.0], [0.0, 1.0, 2.0], [0.0, 1.0, 2.0]), axis=-1).reshape(
        -1, 3
    )
    _find_neighbours.py_func(27, np.zeros(27, dtype=np.int64), clusters)
    distance2 = ((clusters.mean_m[:27, None] - clusters.mean_m[None, :27]) ** 2).sum(axis=2)
    np.fill_diagonal(distance2, np.inf)
    np.testing.assert_array_equal(clusters.near[:27], np.argsort(distance2, axis=1, kind="stable")[:, :NEIGHBOURS])


def test_clusters_that_wait_have_neighbours_only_beside_one_that_does_not() -> None:
    clusters, wait = make_clusters(0), np.ones(30, dtype=np.int64)
    clusters.mean_m[:30, 0] = np.arange(30.0)
    wait[3] = 0
    _find_neighbours.py_func(30, wait, clusters)
    assert [k for k in range(30) if clusters.near[k, 0] >= 0] == [0, 1, 2, 3, 4, 5, 6, 7, 8]
    assert clusters.near[8].tolist() == [7, 9, 6, 10, 5, 11, 4, 12]


def test_wait_lasts_while_a_quarter_per_level_leaves_the_cost_above_the_tolerance() -> None:
    clusters, wait = make_clusters(0), np.array([0, 0, 0, 0, 5, 0])
    clusters.cost[:6] = 0.5, 1.0, 2.0, 9.0, 9.0, np.inf
    _set_waits.py_func(6, 0.5, wait, clusters)
    # 2.0 is 0.5 after one level, 9.0 is 0.14 after three: they are looked at again there.
    assert wait.tolist() == [0, 1, 1, 3, 5, 8]


def test_cheapest_pairs_merge_once_and_merged_clusters_do_not_wait() -> None:
    clusters, wait = make_clusters(0), np.array([3, 0, 0, 4, 0, 0, 2])
    clusters.cost[:7] = 0.7, 0.2, 0.1, 0.1, 0.3, 0.2, 0.9
    clusters.partner[:7] = 6, 5, 3, 2, 2, 1, 0
    # 2 and 3, then 1 and 5; 4 finds its partner taken, 0 and 6 cost too much.
    assert _pair_up.py_func(7, 0.6, clusters) == 5
    assert clusters.number[:7].tolist() == [0, 1, 2, 2, 3, 1, 4]
    _renumber.py_func(7, wait, clusters)
    assert wait[:5].tolist() == [3, 0, 0, 0, 2]
    waiting = np.array([9, 8, 7, 6])
    clusters.number[:4] = 0, 1, 0, 2
    _renumber.py_func(4, waiting, clusters)
    assert waiting[:3].tolist() == [0, 8, 6]
