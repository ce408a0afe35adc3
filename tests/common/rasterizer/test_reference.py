import dataclasses
import math

import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.images.images import OUTPUTS
from readygo.common.rasterizer.reference import ReferenceRasterizer, rasterize_reference
from readygo.common.robot import CameraConfig
from tests.common.rasterizer.drawing import images_of

K = np.array([[20.0, 0.0, 10.5], [0.0, 20.0, 8.5], [0.0, 0.0, 1.0]])


def ball(z_m: float, *, opacity: float = 0.8, rgb: float = 1.0, scale_m: float = 0.5) -> GaussianCloud:
    return GaussianCloud(
        means_m=np.array([[0.0, 0.0, z_m]], dtype=np.float32),
        quats_wxyz=np.array([[1.0, 0.0, 0.0, 0.0]], dtype=np.float32),
        scales_m=np.full((1, 3), scale_m, dtype=np.float32),
        opacities=np.array([opacity], dtype=np.float32),
        sh=np.full((1, 1, 3), (rgb - 0.5) / SH_C0, dtype=np.float32),
    )


def draw(cloud: GaussianCloud) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    images = rasterize_reference(cloud, np.eye(4), K, 17, 21)
    return images.rgb, images.alpha, images.depth_m


def test_centre_pixel_has_the_gaussians_opacity() -> None:
    rgb, alpha, depth = draw(ball(4.0))
    assert alpha[8, 10] == pytest.approx(0.8, abs=1e-6)
    assert rgb[8, 10] == pytest.approx([0.8] * 3, abs=1e-6)
    assert depth[8, 10] == pytest.approx(4.0)


def test_falloff_includes_the_dilation() -> None:
    _, alpha, _ = draw(ball(4.0))
    variance = (20.0 / 4.0 * 0.5) ** 2 + 0.3
    assert alpha[8, 13] == pytest.approx(0.8 * math.exp(-0.5 * 9 / variance), rel=1e-5)


def test_alpha_is_capped() -> None:
    _, alpha, _ = draw(ball(4.0, opacity=1.0))
    assert alpha[8, 10] == pytest.approx(0.99)


def test_nearer_gaussian_hides_the_farther_one_whatever_their_order() -> None:
    near, far = ball(2.0, rgb=0.25), ball(6.0, rgb=1.0)
    for cloud in (concatenate([near, far]), concatenate([far, near])):
        rgb, _, depth = draw(cloud)
        assert rgb[8, 10, 0] == pytest.approx(0.8 * 0.25 + 0.2 * 0.8, rel=1e-4)
        assert depth[8, 10] == pytest.approx((0.8 * 2 + 0.16 * 6) / 0.96, rel=1e-4)


def test_gaussian_before_the_near_plane_is_not_drawn() -> None:
    assert draw(ball(0.049, scale_m=0.01))[1].max() == 0
    assert draw(ball(0.051, scale_m=0.01))[1].max() > 0
    assert draw(ball(-3.0))[1].max() == 0


def test_alpha_below_one_255th_is_skipped() -> None:
    assert draw(ball(4.0, opacity=0.99 / 255))[1].max() == 0
    _, alpha, _ = draw(ball(4.0))
    assert alpha[alpha > 0].min() >= 1 / 255


def test_pixel_stops_after_the_gaussian_that_finishes_it() -> None:
    cloud = concatenate([ball(1.0 + k, opacity=0.98, rgb=0.0 if k < 2 else 1.0) for k in range(4)])
    rgb, alpha, _ = draw(cloud)
    # 0.02^2 = 4e-4 is left after two Gaussians: the third is drawn and leaves 8e-6, the fourth is not.
    assert rgb[8, 10, 0] == pytest.approx(4e-4 * 0.98, rel=1e-3)
    assert alpha[8, 10] == pytest.approx(1 - 8e-6, abs=1e-7)


def test_depth_is_infinite_where_nothing_is() -> None:
    _, alpha, depth = draw(ball(4.0, scale_m=0.05))
    assert np.isinf(depth[alpha == 0]).all()
    assert np.isfinite(depth[alpha > 0]).all()


def test_median_is_the_gaussian_that_takes_the_transmittance_below_one_half() -> None:
    cloud = concatenate([ball(2.0, opacity=0.4), ball(6.0, opacity=0.9), ball(4.0, opacity=0.3)])
    images = rasterize_reference(cloud, np.eye(4), K, 17, 21, instances=[7, 8, 9])
    # 0.6 of the light is left after the first, 0.42 after the second.
    assert images.median_depth_m[8, 10] == pytest.approx(4.0)
    assert images.mask[8, 10] == 9
    half_left = images.alpha < 0.5
    assert half_left.any()
    assert np.isposinf(images.median_depth_m[half_left]).all()
    assert images.mask[half_left].max() == 0


def test_normal_is_the_shortest_axis_towards_the_camera() -> None:
    # The camera at the origin looks along its z at a disc that is tilted by 60 deg about its x.
    for half_turn in (30.0, 30.0 + 90.0):
        angle = math.radians(half_turn)
        disc = dataclasses.replace(
            ball(4.0),
            quats_wxyz=np.array([[math.cos(angle), math.sin(angle), 0.0, 0.0]], dtype=np.float32),
            scales_m=np.array([[0.5, 0.4, 0.1]], dtype=np.float32),
        )
        normal = rasterize_reference(disc, np.eye(4), K, 17, 21).normal
        assert normal[8, 10] == pytest.approx([0.0, math.sqrt(0.75), -0.5], abs=1e-6)
        assert np.abs(normal[0, 0]).max() == 0


def test_no_cloud_at_all_is_drawn_as_an_empty_one(make_cloud) -> None:
    camera = CameraConfig(height_px=24, width_px=40)
    images, empty = (
        images_of(ReferenceRasterizer(clouds, {}, camera), np.eye(4), (), OUTPUTS) for clouds in ([], [make_cloud(0)])
    )
    for name, array in images.arrays().items():
        assert np.array_equal(array, empty.arrays()[name]), name
    assert not images.rgb.any()
