import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import View
from readygo.common.rasterizer.packed.scene import pack_cloud

SH_OF_BLACK, SH_OF_WHITE = -0.5 / 0.28209479, 0.5 / 0.28209479


def balls(*opacities_and_colours):
    """Balls of 1 m behind each other along x, the nearest first."""
    opacities, colours = zip(*opacities_and_colours, strict=True)
    count = len(opacities)
    return GaussianCloud(
        means_m=np.stack([3.0 + 2.0 * np.arange(count), np.zeros(count), np.full(count, 1.2)], 1).astype(np.float32),
        quats_wxyz=np.tile(np.float32([1, 0, 0, 0]), (count, 1)),
        scales_m=np.ones((count, 3), np.float32),
        opacities=np.float32(opacities),
        sh=np.repeat(np.float32(colours)[:, None, None], 3, axis=2),
    )


def centre(cloud, camera):
    """Brightness where all balls are centred."""
    T, K = camera(0.0, 0.0, 0.0, 64, 64, pitch=0.0)
    K[:2, 2] = 32.5
    return CpuRasterizer(pack_cloud(cloud), {}, K, 64, 64).render_float(View(T_world_camera=T))[32, 32]


def test_opaque_ball_lets_a_hundredth_of_the_light_through(camera):
    behind_opaque = centre(balls((1.0, SH_OF_BLACK), (1.0, SH_OF_WHITE)), camera)
    assert behind_opaque == pytest.approx(0.01 * 0.99, rel=0.02)
    assert centre(balls((1.0, SH_OF_WHITE)), camera) == pytest.approx(0.99, abs=1e-4)


def test_nearer_balls_hide_farther_ones_by_their_opacity(camera):
    assert centre(balls((0.25, SH_OF_WHITE), (1.0, SH_OF_BLACK)), camera) == pytest.approx(0.25, abs=2e-3)
    assert centre(balls((0.25, SH_OF_BLACK), (0.5, SH_OF_WHITE)), camera) == pytest.approx(0.75 * 0.5, abs=2e-3)


def test_ball_fainter_than_the_least_alpha_is_not_drawn(camera):
    assert centre(balls((0.9 / 255, SH_OF_WHITE)), camera).max() == 0.0
    assert centre(balls((1.2 / 255, SH_OF_WHITE)), camera).min() > 0.0
