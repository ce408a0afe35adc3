"""The comparison itself, and the CPU rasterizer on the real scenes: at least 60 dB, off at depth near-ties only."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from readygo.benchmarks.rasterizer.exactness import (
    ViewError,
    in_packed_order,
    largest_change_by_order,
    summary,
    view_error,
)
from readygo.benchmarks.rasterizer.footprints import footprints, pixel_stack
from readygo.common.gaussians import GaussianCloud, R_from_up, concatenate, load_gaussians, transform_cloud
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.rasterizer.reference import rasterize_reference
from readygo.common.robot import CameraConfig
from tests.common.rasterizer.drawing import float_rgb_of

CAMERA = CameraConfig(height_px=72, width_px=128)


def balls(depths_m: list[float]) -> GaussianCloud:
    count = len(depths_m)
    rng = np.random.default_rng(0)
    return GaussianCloud(
        means_m=np.stack([np.zeros(count), np.zeros(count), depths_m], axis=1).astype(np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (count, 1)),
        scales_m=np.full((count, 3), 0.5, dtype=np.float32),
        opacities=np.full(count, 0.6, dtype=np.float32),
        sh=rng.uniform(-1.5, 1.5, (count, 1, 3)).astype(np.float32),
    )


def reference(cloud: GaussianCloud) -> np.ndarray:
    return rasterize_reference(cloud, np.eye(4), CAMERA.K_px, 72, 128).rgb


def change_at_centre(cloud: GaussianCloud) -> np.ndarray:
    prints = footprints(cloud, np.eye(4), CAMERA.K_px, 72, 128)
    return largest_change_by_order(pixel_stack(prints, cloud, np.eye(4), 36, 64))


def test_change_by_order_bounds_what_another_order_of_equal_depths_does() -> None:
    cloud = balls([2.0, 2.0, 2.0, 3.0])
    moved = np.abs(reference(cloud) - reference(cloud.select(np.array([2, 1, 0, 3]))))[36, 64]
    bound = change_at_centre(cloud)
    assert moved.max() > 0.1
    assert (moved <= bound + 1e-6).all()
    assert bound.max() < 2.0


def test_two_equal_depths_change_by_exactly_the_bound() -> None:
    cloud = balls([1.0, 2.0, 2.0])
    moved = np.abs(reference(cloud) - reference(cloud.select(np.array([0, 2, 1]))))[36, 64]
    np.testing.assert_allclose(moved, change_at_centre(cloud), atol=1e-5)


def test_depths_apart_cannot_change_places() -> None:
    assert change_at_centre(balls([2.0, 2.0001, 3.0])).max() == 0.0


def test_other_order_of_a_tie_is_off_but_accounted_for() -> None:
    cloud = balls([2.0, 2.0, 3.0])
    error = view_error(reference(cloud.select(np.array([1, 0, 2]))), cloud, np.eye(4), CAMERA)
    assert error.pixels_off > 100
    assert error.pixels_off_at_near_ties == error.pixels_off


def test_wrong_colour_without_a_tie_is_not_accounted_for() -> None:
    cloud = balls([2.0, 2.5, 3.0])
    image = reference(cloud)
    image[36, 64, 1] += 3 / 255
    error = view_error(image, cloud, np.eye(4), CAMERA)
    assert (error.values_off, error.pixels_off, error.pixels_off_at_near_ties) == (1, 1, 0)
    assert error.max_difference == pytest.approx(3.0, abs=0.01)
    assert error.psnr_db == pytest.approx(-10 * math.log10((3 / 255) ** 2 / (72 * 128 * 3)), abs=0.1)


def test_target_is_missed_by_one_dark_view_or_one_unexplained_pixel() -> None:
    good = ViewError(psnr_db=80.0, max_difference=3.0, values_off=1, pixels_off=1, pixels_off_at_near_ties=1)
    assert summary([good, good])["passed"]
    assert not summary([good, dataclasses.replace(good, psnr_db=59.9)])["passed"]
    assert not summary([good, dataclasses.replace(good, pixels_off_at_near_ties=0)])["passed"]


def scene_error(clouds: list[GaussianCloud], x_m: float, y_m: float, yaw_rad: float, floor_m: float) -> ViewError:
    T = CAMERA.T_world_camera(x_m, y_m, yaw_rad, floor_m)
    image = float_rgb_of(CpuRasterizer([pack_cloud(cloud) for cloud in clouds], {}, CAMERA.K_px, 72, 128), T)
    assert image.max() > 0.2
    return view_error(image, concatenate([in_packed_order(cloud) for cloud in clouds]), T, CAMERA)


def assert_exact(error: ViewError) -> None:
    assert error.psnr_db >= 60
    assert error.pixels_off == error.pixels_off_at_near_ties


@pytest.mark.parametrize("yaw_rad", [0.4, 2.5])
def test_flowers_are_exact(shared_data: Path, yaw_rad: float) -> None:
    stored = load_gaussians(shared_data / "scenes" / "flowers.compressed.ply")
    cloud = transform_cloud(stored, R_from_up("-y"), scale=5.0)
    assert_exact(scene_error([cloud], -3 * math.cos(yaw_rad), -3 * math.sin(yaw_rad), yaw_rad, 0.3))


@pytest.mark.slow
@pytest.mark.parametrize("yaw_rad", [2.2])
def test_showroom_is_exact(shared_data: Path, yaw_rad: float) -> None:
    names = ("showroom.compressed.ply", "showroom_env.compressed.ply")
    assert_exact(scene_error([load_gaussians(shared_data / "scenes" / name) for name in names], 0.0, 0.0, yaw_rad, 0.0))


@pytest.mark.slow
@pytest.mark.parametrize("yaw_rad", [0.5])
def test_large_outdoor_scene_is_exact(shared_data: Path, yaw_rad: float) -> None:
    cloud = load_gaussians(shared_data / "scenes" / "taebak.compressed.ply")
    assert_exact(scene_error([cloud], 5.0, -3.0, yaw_rad, 0.8))
