"""Forward images of the differentiable rasterizer."""

from collections.abc import Callable

import numpy as np
import pytest
from numba import njit

from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.rasterizer.reference import rasterize_reference
from readygo.common.simd.memory import load_f16, store_f16
from readygo.services.reconstructor.differentiable.autograd import rasterize
from readygo.services.reconstructor.differentiable.blend import exp2
from tests.common.rasterizer.drawing import float_rgb_of, psnr_db


@pytest.mark.parametrize("size_px", [(36, 52), (144, 256)])
def test_image_is_that_of_the_other_backends(case: Callable, size_px: tuple[int, int]) -> None:
    many = case(20_000, scale_m=0.03, height_px=size_px[0], width_px=size_px[1])
    rendered = rasterize(**many.parameters, **many.camera)
    pose = many.T_world_camera.detach().numpy()
    expected = rasterize_reference(many.cloud(), pose, many.K_px, *size_px)
    rgb = rendered.rgb.detach().numpy()
    assert psnr_db(rgb, expected.rgb) >= 60
    assert psnr_db(rendered.alpha.detach().numpy(), expected.alpha) >= 60
    drawn = expected.alpha > 0.01
    assert np.abs(rendered.depth_m.detach().numpy() - expected.depth_m)[drawn].max() < 1e-2
    other = float_rgb_of(CpuRasterizer(pack_cloud(many.cloud()), {}, many.K_px, *size_px), pose)
    assert psnr_db(rgb, other) >= 60


@njit
def _exp2_of(t, out):
    store_f16(out, 0, exp2(load_f16(t, 0)))


def test_power_of_two_is_exact_to_three_millionths() -> None:
    t, out = np.linspace(-126.0, 1.0, 4096).astype(np.float32), np.empty(16, np.float32)
    for start in range(0, 4096, 16):
        _exp2_of(t[start : start + 16], out)
        assert out == pytest.approx(np.exp2(t[start : start + 16].astype(np.float64)), rel=3e-6)
