"""One merged Gaussian in place of some."""

import numpy as np
import pytest

from readygo.common.rasterizer.lod.clusters import Originals, gather_region, make_clusters, opacity_of_cover
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


def gathered(gaussians: Originals, pixel_m: float = 0.001):
    clusters = make_clusters(0)
    count = len(gaussians.opacity)
    gather_region(gaussians, np.zeros(count, dtype=np.int32), 0, count, 1, pixel_m, clusters)
    return clusters


def merged_count(gaussians: Originals, tolerance: float, pixel_m: float) -> int:
    count = len(gaussians.opacity)
    label, counts = np.arange(count, dtype=np.int32), np.array([count])
    wait, leeway = np.zeros(count, dtype=np.int64), np.ones(1)
    rule = MergeRule(pixel_m, tolerance, 0.1, 0.5)
    first = np.array([0, count])
    merge_regions(gaussians, label, first, counts, wait, leeway, rule, 5, make_clusters(0))
    assert sorted(set(label.tolist())) == list(range(counts[0]))
    return int(counts[0])


@pytest.mark.parametrize("opacity", [0.05, 0.6, 0.99])
def test_one_gaussian_keeps_its_opacity_moments_and_colour(opacity: float) -> None:
    clusters = gathered(originals([(1.0, 2.0, 3.0)], opacity))
    assert opacity_of_cover(clusters.cover[0]) == pytest.approx(opacity, rel=1e-3)
    assert np.allclose(clusters.mean_m[0], 0.0, atol=1e-12)
    assert np.allclose(clusters.covariance_m2[0], [SIGMA_M**2, 0, 0, SIGMA_M**2, 0, SIGMA_M**2], atol=1e-12)
    assert np.allclose(clusters.colour[0], 0.5)


@pytest.mark.parametrize("layers", [2, 5, 40])
def test_gaussians_behind_each_other_cover_as_much_as_their_composite(layers: int) -> None:
    opacity = 0.6
    clusters = gathered(originals([(0.0, 0.0, 0.0)] * layers, opacity))
    u = (np.arange(200000) + 0.5) * 1e-4
    composite = float((1 - (1 - opacity * np.exp(-u)) ** layers).sum() * 1e-4)
    assert clusters.cover[0] == pytest.approx(composite, rel=0.01)


@pytest.mark.parametrize("cover", [0.3, 0.99, 1.5, 3.0])
def test_opacity_gives_the_cover(cover: float) -> None:
    opacity = opacity_of_cover(cover)
    u = (np.arange(400000) + 0.5) * 5e-5
    assert float(np.minimum(0.99, opacity * np.exp(-u)).sum() * 5e-5) == pytest.approx(cover, rel=1e-3)


def test_spread_of_means_adds_to_the_covariance() -> None:
    clusters = gathered(originals([(0.0, 0.0, 0.0), (0.1, 0.0, 0.0)], 0.5))
    assert clusters.mean_m[0, 0] == pytest.approx(0.05)
    assert clusters.covariance_m2[0, 0] == pytest.approx(SIGMA_M**2 + 0.05**2)


def test_neighbours_merge_when_pixels_are_large_enough_to_hide_it() -> None:
    row = originals([(0.03 * k, 0.0, 0.0) for k in range(8)], 0.8)
    counts = [merged_count(row, 0.01, pixel_m) for pixel_m in (0.003, 0.03, 0.3, 3.0)]
    assert counts[0] == 8
    assert counts == sorted(counts, reverse=True)
    assert counts[-1] == 1


def test_different_colours_merge_later() -> None:
    means = [(0.01 * k, 0.0, 0.0) for k in range(6)]
    same = originals(means, 0.8)
    striped = originals(means, 0.8, [0.0, 1.0] * 3)
    assert merged_count(same, 0.01, 0.02) < merged_count(striped, 0.01, 0.02)


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
