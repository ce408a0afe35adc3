"""What a merger costs."""

import numpy as np
import pytest

from readygo.common.rasterizer.constants import DILATION_PX2
from readygo.common.rasterizer.lod.clusters import Clusters, gather_region, make_clusters
from readygo.common.rasterizer.lod.cost import MergeRule, find_unrest, merger_cost
from tests.common.rasterizer.lod.merging import SIGMA_M, merged_count, originals


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
    most: float = np.inf,
) -> float:
    """Of merging two Gaussians of SIGMA_M that lie beside each other."""
    pair, clusters = originals([(0.0, 0.0, 0.0), (distance_m, 0.0, 0.0)], 0.6, list(colours)), make_clusters(0)
    gather_region(pair, np.arange(2, dtype=np.int32), 0, 2, 2, pixel_m, clusters)
    rule = MergeRule(pixel_m, 0.01, contrast, 0.5)
    make_neighbours(clusters, rule, distance_m)
    clusters.unrest[:] = unrest
    return float(merger_cost(0, 0, most, rule, clusters))


def make_neighbours(clusters: Clusters, rule: MergeRule, distance_m: float) -> None:
    """Let clusters 0 and 1 be the neighbours of each other."""
    clusters.near[:2], clusters.distance2[:2] = -1, np.inf
    clusters.near[:2, 0], clusters.distance2[:2, 0] = (1, 0), distance_m**2
    find_unrest.py_func(2, rule, clusters)


def test_merger_costs_more_the_farther_apart_the_two_are() -> None:
    costs = [cost(distance_m) for distance_m in (0.01, 0.05, 0.1, 0.2)]
    assert costs == sorted(costs)
    assert costs[0] < 0.1 * costs[-1]


def test_merger_costs_less_where_pixels_are_larger() -> None:
    costs = [cost(0.05, pixel_m=pixel_m) for pixel_m in (0.01, 0.03, 0.1, 0.3)]
    assert costs == sorted(costs, reverse=True)


@pytest.mark.parametrize("unrest", [0.0, 3e-4, 0.2])
def test_cost_is_told_if_it_is_less_than_the_most_that_is_asked_for(unrest: float) -> None:
    arguments = {"colours": (0.2, 0.6), "unrest": unrest}
    exact = cost(0.1, **arguments)
    assert cost(0.1, **arguments, most=exact * 1.0001) == exact
    assert [cost(0.1, **arguments, most=exact * share) for share in (1.0, 0.7, 0.3, 0.0)] == [np.inf] * 4


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


def test_cost_is_the_squared_error_of_the_images_that_three_projections_show() -> None:
    """Two Gaussians that differ in all: alphas are drawn on a fine grid, and squared errors summed."""
    rng, pixel_m, contrast = np.random.default_rng(2), 0.013, 0.07
    roots = rng.normal(0.0, 0.02, (2, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1) + 2e-5 * np.eye(3)
    means, opacities = np.array([[0.0, 0.0, 0.0], [0.023, -0.017, 0.031]]), np.array([0.85, 0.35])
    colours = np.array([[0.9, 0.2, 0.4], [0.1, 0.3, 0.6]])
    pair = originals([(0.0, 0.0, 0.0)] * 2, 0.5)._replace(
        mean_m=means,
        covariance_m2=covariances[:, *np.triu_indices(3)].copy(),
        opacity=opacities,
        colour=colours,
    )
    clusters = make_clusters(0)
    gather_region(pair, np.arange(2, dtype=np.int32), 0, 2, 2, pixel_m, clusters)
    rule = MergeRule(pixel_m, 0.01, contrast, 0.5)
    make_neighbours(clusters, rule, float(np.linalg.norm(means[1] - means[0])))
    clusters.unrest[:2] = 2e-4, 7e-4

    dilated = covariances + DILATION_PX2 * pixel_m**2 * np.eye(3)
    areas = np.array([_area_m2(covariance) for covariance in dilated])
    share_0, share_1 = opacities * areas / (opacities @ areas)
    middle = share_0 * means[0] + share_1 * means[1]
    spread = sum(
        share * (covariance + np.outer(mean - middle, mean - middle))
        for share, covariance, mean in zip((share_0, share_1), dilated, means, strict=True)
    )
    merged_opacity = opacities @ areas / _area_m2(spread)
    contrast2, total = ((colours[0] - colours[1]) ** 2).sum(), 0.0
    axis = np.linspace(-0.45, 0.45, 601)
    for axes in ([0, 1], [0, 2], [1, 2]):
        first, second, merged = (
            _peak_1(covariance[np.ix_(axes, axes)], mean[axes], axis)
            for covariance, mean in ((dilated[0], means[0]), (dilated[1], means[1]), (spread, middle))
        )
        a, b = opacities[0] * first, opacities[1] * second
        total += contrast * ((a + b - merged_opacity * merged) ** 2).sum()
        total += contrast2 * ((share_1 * a - share_0 * b) ** 2).sum()
        total += contrast2 * 0.25 * ((a * b) ** 2).sum()
    total *= (axis[1] - axis[0]) ** 2
    total += np.pi * np.linalg.norm(means[1] - means[0]) * (share_1 * 2e-4 + share_0 * 7e-4)
    assert merger_cost(0, 0, np.inf, rule, clusters) == pytest.approx(total / (3.0 * pixel_m**2), rel=1e-6)
    unrest = clusters.unrest.copy()
    clusters.unrest[:2] = unrest[1::-1]
    assert merger_cost(0, 0, np.inf, rule, clusters) != pytest.approx(total / (3.0 * pixel_m**2), rel=1e-6)


def _area_m2(covariance: np.ndarray) -> float:
    minors = [np.linalg.det(covariance[np.ix_(axes, axes)]) for axes in ([0, 1], [0, 2], [1, 2])]
    return float(np.sqrt(sum(minors)))


def _peak_1(covariance: np.ndarray, mean: np.ndarray, axis: np.ndarray) -> np.ndarray:
    offsets = np.stack(np.meshgrid(axis - mean[0], axis - mean[1], indexing="ij"), axis=-1)
    return np.exp(-0.5 * np.einsum("ijk,kl,ijl->ij", offsets, np.linalg.inv(covariance), offsets))


def test_unrest_is_the_cost_of_a_swapped_order_per_metre_over_the_neighbours() -> None:
    row = originals([(0.0, 0.0, 0.0), (0.03, 0.0, 0.0), (0.0, 0.05, 0.0)], 0.7, [0.1, 0.5, 0.9])
    clusters, pixel_m = make_clusters(0), 0.01
    gather_region(row, np.arange(3, dtype=np.int32), 0, 3, 3, pixel_m, clusters)
    clusters.near[:3], clusters.distance2[:3] = -1, np.inf
    clusters.near[0, :2], clusters.distance2[0, :2] = (1, 2), (0.03**2, 0.05**2)
    clusters.near[1, 0], clusters.distance2[1, 0] = 0, 0.0
    find_unrest.py_func(3, MergeRule(pixel_m, 0.01, 0.1, 0.5), clusters)
    variance = SIGMA_M**2 + DILATION_PX2 * pixel_m**2

    def swapped(distance_m: float) -> float:
        # (g g')^2 of two equal round Gaussians: beside each other in two projections, over each other in the third.
        return 0.25 * 0.7**4 * variance / 2.0 * (2.0 * np.exp(-(distance_m**2) / (2.0 * variance)) + 1.0)

    expected = 3 * 0.4**2 * swapped(0.03) / 0.03 + 3 * 0.8**2 * swapped(0.05) / 0.05
    assert clusters.unrest[0] == pytest.approx(expected, rel=1e-6)
    assert clusters.unrest[1] == pytest.approx(3 * 0.4**2 * swapped(0.03) / (0.01 * pixel_m), rel=1e-6)
    assert clusters.unrest[2] == 0.0
