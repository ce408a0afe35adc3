"""Gaussians in training as arrays."""

import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.services.reconstructor.training.parameters import Change, Gaussians, initial_gaussians

POINTS = np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1], [5, 5, 5]])


def test_points_become_gaussians_as_large_as_their_neighbours_are_away() -> None:
    rgb = np.array([[255, 0, 128]] * 5, dtype=np.uint8)
    gaussians = initial_gaussians(POINTS, rgb, 2, 0.1)
    cloud = gaussians.cloud()
    np.testing.assert_allclose(cloud.scales_m[0], 1.0, rtol=1e-6)
    np.testing.assert_allclose(cloud.scales_m[1], np.sqrt(5 / 3), rtol=1e-6)
    np.testing.assert_allclose(cloud.opacities, 0.1, rtol=1e-6)
    np.testing.assert_allclose(0.5 + 0.28209479 * cloud.sh[0, 0], [1.0, 0.0, 128 / 255], atol=1e-6)
    assert cloud.sh.shape == (5, 9, 3)


def test_state_of_the_optimiser_follows_selected_gaussians_and_fresh_ones_have_none() -> None:
    gaussians = initial_gaussians(POINTS, np.zeros((5, 3), np.uint8), 0, 0.1)
    gaussians.first["logits"][:, 0] = np.arange(5)
    gaussians.updates[:] = np.arange(5)
    chosen = gaussians.select(np.array([3, 1]))
    same = Change.none(chosen.values)
    copies = same.select(np.array([1, 0]))
    copies.fresh[:] = True
    copies.logits += 1.0
    both = chosen.apply(same.join(copies))
    np.testing.assert_allclose(both.values["logits"][2:], chosen.values["logits"][::-1] + 1.0)
    np.testing.assert_array_equal(both.values["means_m"][2:], chosen.values["means_m"][::-1])
    np.testing.assert_array_equal(both.updates, [3, 1, 0, 0])
    np.testing.assert_array_equal(both.first["logits"][:, 0], [3, 1, 0, 0])
    both.forget(np.array([0]))
    np.testing.assert_array_equal(both.updates, [0, 1, 0, 0])


def test_state_comes_back_whole() -> None:
    gaussians = initial_gaussians(POINTS, np.zeros((5, 3), np.uint8), 1, 0.1)
    again = Gaussians.from_state(gaussians.state())
    for name, array in gaussians.state().items():
        np.testing.assert_array_equal(again.state()[name], array)
    assert len(again) == 5
    assert gaussians.scales_m[0, 0] == pytest.approx(1.0)


def test_gaussians_of_a_cloud_are_that_cloud_again() -> None:
    rng = np.random.default_rng(0)
    quats = rng.normal(size=(5, 4)).astype(np.float32)
    cloud = GaussianCloud(
        means_m=rng.normal(size=(5, 3)).astype(np.float32),
        quats_wxyz=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales_m=rng.uniform(0.01, 0.1, (5, 3)).astype(np.float32),
        opacities=np.array([0.1, 0.5, 0.9, 1.0, 0.0], np.float32),
        sh=rng.normal(size=(5, 4, 3)).astype(np.float32),
    )
    gaussians = Gaussians.of_cloud(cloud)
    assert np.isfinite(gaussians.values["logits"]).all()
    for name in ("means_m", "quats_wxyz", "scales_m", "opacities", "sh"):
        np.testing.assert_allclose(getattr(gaussians.cloud(), name), getattr(cloud, name), atol=1e-5)
