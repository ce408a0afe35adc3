"""Moments of clusters of Gaussians."""

import numpy as np
import pytest

from readygo.common.rasterizer.constants import DILATION_PX2
from readygo.common.rasterizer.lod.clusters import Originals, gather_region, make_clusters, opacity_of_cover
from tests.common.rasterizer.lod.merging import SIGMA_M, originals


def gathered(gaussians: Originals, pixel_m: float = 0.001):
    clusters = make_clusters(0)
    count = len(gaussians.opacity)
    gather_region(gaussians, np.zeros(count, dtype=np.int32), 0, count, 1, pixel_m, clusters)
    return clusters


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


def test_clusters_of_crooked_gaussians_have_the_moments_of_their_mixture() -> None:
    """Weights are opacity times mean dilated area; means are from the region's first Gaussian on."""
    rng, pixel_m = np.random.default_rng(3), 0.017
    roots = rng.normal(0.0, 0.02, (9, 3, 3))
    covariances = roots @ roots.transpose(0, 2, 1) + 1e-5 * np.eye(3)
    means, opacities = rng.normal(0.3, 0.05, (9, 3)), rng.uniform(0.1, 0.95, 9)
    colours, skins = rng.random((9, 3)), rng.random((9, 24)).astype(np.float32)
    gaussians = Originals(means, covariances[:, *np.triu_indices(3)].copy(), opacities, colours, skins)
    labels, clusters = np.array([0, 1, 0, 1, 1, 0, 1, 0, 2], np.int32), make_clusters(24)
    gather_region(gaussians, labels, 1, 9, 3, pixel_m, clusters)
    dilated = covariances + DILATION_PX2 * pixel_m**2 * np.eye(3)
    minors = [np.linalg.det(dilated[:, axes][:, :, axes]) for axes in ([0, 1], [0, 2], [1, 2])]
    weights = opacities * np.sqrt(sum(minors))
    for cluster in range(3):
        own = np.flatnonzero(labels == cluster)
        own = own[own >= 1]
        share = weights[own] / weights[own].sum()
        mean = share @ means[own]
        spread = np.einsum("n,nij->ij", share, covariances[own])
        spread += np.einsum("n,ni,nj->ij", share, means[own] - mean, means[own] - mean)
        assert clusters.weight[cluster] == pytest.approx(weights[own].sum())
        np.testing.assert_allclose(clusters.mean_m[cluster], mean - means[1], atol=1e-12)
        np.testing.assert_allclose(clusters.covariance_m2[cluster], spread[np.triu_indices(3)], atol=1e-12)
        np.testing.assert_allclose(clusters.colour[cluster], share @ colours[own])
        np.testing.assert_allclose(clusters.skin[cluster], share @ skins[own], rtol=1e-6)
        assert clusters.opacity[cluster] == pytest.approx(share @ opacities[own])
