"""Projection by the Triton kernels."""

import numpy as np
import pytest

from readygo.common.gaussians import transform_cloud
from readygo.common.rasterizer.reference import rasterize_reference
from tests.common.rasterizer.drawing import (
    assert_like_reference,
    float_rgb_of,
    with_arrays,
)


@pytest.mark.parametrize("coefficients", [9, 16])
def test_higher_harmonics_look_as_in_the_reference(make_cloud, camera, rasterizer, coefficients: int) -> None:
    cloud = make_cloud(90, coefficients=coefficients)
    T, K = camera(-4.0, 0.5, 0.2, 32, 24)
    image = float_rgb_of(rasterizer(cloud, [], K, 24, 32), T)
    assert_like_reference(image, rasterize_reference(cloud, T, K, 24, 32).rgb)


def test_gaussians_around_the_camera_look_as_in_the_reference(make_cloud, camera, rasterizer) -> None:
    cloud = make_cloud(200, low=(-0.6, -0.6, 0.6), high=(0.6, 0.6, 1.8), scale_m=0.03)
    for yaw in (0.0, 2.6):
        T, K = camera(0.0, 0.0, yaw, 37, 29)
        image = float_rgb_of(rasterizer(cloud, [], K, 29, 37), T)
        assert_like_reference(image, rasterize_reference(cloud, T, K, 29, 37).rgb)


def test_scene_far_from_the_origin_is_as_sharp(make_cloud, camera, rasterizer) -> None:
    shift = (900.0, -1400.0, 0.0)
    cloud = transform_cloud(make_cloud(80), np.eye(3), shift)
    T, K = camera(-4.0 + shift[0], shift[1], 0.0, 32, 24)
    assert_like_reference(
        float_rgb_of(rasterizer(cloud, [], K, 24, 32), T), rasterize_reference(cloud, T, K, 24, 32).rgb
    )


def test_gaussians_that_are_not_finite_do_not_reach_the_image(make_cloud, camera, rasterizer) -> None:
    cloud = make_cloud(60)
    means = cloud.means_m.copy()
    means[::7] = np.nan
    T, K = camera(-4.0, 0.0, 0.0, 32, 24)
    image = float_rgb_of(rasterizer(with_arrays(cloud, means_m=means), [], K, 24, 32), T)
    kept = cloud.select(np.isfinite(means).all(axis=1))
    assert_like_reference(image, rasterize_reference(kept, T, K, 24, 32).rgb)
