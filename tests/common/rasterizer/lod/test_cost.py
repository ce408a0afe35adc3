"""What a merger costs."""

import numpy as np
import pytest

from readygo.common.rasterizer.lod.clusters import gather_region, make_clusters
from readygo.common.rasterizer.lod.cost import MergeRule, merger_cost
from tests.common.rasterizer.lod.merging import merged_count, originals


def test_different_colours_merge_later() -> None:
    means = [(0.01 * k, 0.0, 0.0) for k in range(6)]
    same = originals(means, 0.8)
    striped = originals(means, 0.8, [0.0, 1.0] * 3)
    assert merged_count(same, 0.01, 0.02) < merged_count(striped, 0.01, 0.02)


def cost(
    distance_m: float,
    *,
    pixel_m: float = 0.02,
    colours: tuple[float, float] = (0.5, 0.5),
    contrast: float = 0.1,
    unrest: float = 0.0,
) -> float:
    """Of merging two Gaussians of SIGMA_M that lie beside each other."""
    pair, clusters = originals([(0.0, 0.0, 0.0), (distance_m, 0.0, 0.0)], 0.6, list(colours)), make_clusters(0)
    gather_region(pair, np.arange(2, dtype=np.int32), 0, 2, 2, pixel_m, clusters)
    clusters.unrest[:] = unrest
    return float(merger_cost(0, 1, MergeRule(pixel_m, 0.01, contrast, 0.5), clusters))


def test_merger_costs_more_the_farther_apart_the_two_are() -> None:
    costs = [cost(distance_m) for distance_m in (0.01, 0.05, 0.1, 0.2)]
    assert costs == sorted(costs)
    assert costs[0] < 0.1 * costs[-1]


def test_merger_costs_less_where_pixels_are_larger() -> None:
    costs = [cost(0.05, pixel_m=pixel_m) for pixel_m in (0.01, 0.03, 0.1, 0.3)]
    assert costs == sorted(costs, reverse=True)


def test_error_of_coverage_shows_by_the_contrast_with_what_is_behind() -> None:
    assert cost(0.1, contrast=0.2) == pytest.approx(2.0 * cost(0.1, contrast=0.1))


def test_mean_that_moves_pays_for_its_neighbours() -> None:
    """Both means move by half of their distance; costs are in pixels, as means of three projections."""
    extra = cost(0.1, unrest=3e-4) - cost(0.1)
    assert extra == pytest.approx(0.1 * 3e-4 * np.pi / (3.0 * 0.02**2), rel=1e-6)


def test_other_colours_cost_their_squared_difference() -> None:
    extra = [cost(0.1, colours=(0.5 - d, 0.5 + d)) - cost(0.1) for d in (0.1, 0.2)]
    assert extra[1] == pytest.approx(4.0 * extra[0], rel=1e-6)
    assert extra[0] > 0
