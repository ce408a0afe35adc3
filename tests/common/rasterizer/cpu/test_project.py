"""Projection by the CPU rasterizer."""

import numpy as np
import pytest
from numba import njit

from readygo.common.avatars import Avatar
from readygo.common.gaussians import transform_cloud
from readygo.common.rasterizer.cpu.project import pixels_within
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.rasterizer.reference import rasterize_reference
from readygo.common.simd.memory import load_f16, store_i16
from readygo.common.simd.types import mask_bits
from tests.common.rasterizer.drawing import assert_like_reference, float_rgb_of, human, numbered, posed, psnr_db


@pytest.mark.parametrize("coefficients", [1, 4, 9, 16])
def test_cloud_looks_as_in_the_reference(make_cloud, camera, coefficients: int) -> None:
    cloud = make_cloud(4000, coefficients=coefficients)
    T, K = camera(-3.0, 1.0, -0.4, 96, 64)
    image = float_rgb_of(CpuRasterizer(pack_cloud(cloud), {}, K, 64, 96), T)
    assert_like_reference(image, rasterize_reference(cloud, T, K, 64, 96).rgb)


def test_gaussians_around_the_camera_look_as_in_the_reference(make_cloud, camera) -> None:
    # Close Gaussians far off the axis are where culling and the clamped Jacobian matter.
    cloud = make_cloud(3000, low=(-0.6, -0.6, 0.6), high=(0.6, 0.6, 1.8), scale_m=0.03)
    for yaw in (0.0, 1.3, 2.6):
        T, K = camera(0.0, 0.0, yaw, 96, 64)
        image = float_rgb_of(CpuRasterizer(pack_cloud(cloud), {}, K, 64, 96), T)
        assert_like_reference(image, rasterize_reference(cloud, T, K, 64, 96).rgb)


def test_scene_far_from_the_origin_is_as_sharp(make_cloud, camera) -> None:
    shift = (900.0, -1400.0, 0.0)
    cloud = transform_cloud(make_cloud(1500), np.eye(3), shift)
    T, K = camera(-5.0 + shift[0], shift[1], 0.0, 256, 144)
    image = float_rgb_of(CpuRasterizer(pack_cloud(cloud), {}, K, 144, 256), T)
    assert psnr_db(image, rasterize_reference(cloud, T, K, 144, 256).rgb) > 50


def test_human_around_the_camera_looks_as_in_the_reference(make_cloud, camera, avatar: Avatar) -> None:
    cloud, humans = make_cloud(300), [human(0.1, 0.05, seed=3)]
    for yaw in (0.0, 1.6, 3.1):
        T, K = camera(0.0, 0.0, yaw, 96, 64)
        image = float_rgb_of(CpuRasterizer(pack_cloud(cloud), numbered([avatar]), K, 64, 96), T, humans)
        assert_like_reference(image, rasterize_reference(posed(cloud, [avatar], humans), T, K, 64, 96).rgb)


@njit
def _pixels(low, high, last, out):
    first, final, some = pixels_within(load_f16(low, 0), load_f16(high, 0), last)
    store_i16(out, 0, first)
    store_i16(out, 16, final)
    return mask_bits(some)


def test_pixels_within_a_range_are_whole_numbers_of_the_image() -> None:
    low = np.float32([-9, -2, -2, 0, 0.5, 1, 1.2, 3, 3.1, 6, 6.5, 7, 8, 5, -0.5, 2])
    high = np.float32([-1, -0.1, 0, 0, 1.5, 1, 1.8, 4, 9, 7, 9, 7, 9, 4, 99, 2.9])
    out, last = np.empty(32, np.int32), 7
    bits = _pixels(low, high, np.float32(last), out)
    for lane in range(16):
        pixels = [k for k in range(last + 1) if low[lane] <= k <= high[lane]]
        assert bool(bits >> lane & 1) == bool(pixels)
        if pixels:
            assert (out[lane], out[16 + lane]) == (pixels[0], pixels[-1])
