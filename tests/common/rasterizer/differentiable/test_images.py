"""Forward images, input checks and memory of the differentiable rasterizer."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch

from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.differentiable.autograd import rasterize
from readygo.common.rasterizer.differentiable.order import spatial_order
from readygo.common.rasterizer.differentiable.pool import ArrayPool
from readygo.common.rasterizer.packed.scene import pack_cloud
from readygo.common.rasterizer.reference import rasterize_reference
from tests.common.rasterizer.drawing import float_rgb_of


def psnr_db(a: np.ndarray, b: np.ndarray) -> float:
    return -10 * np.log10(max(float(((a.astype(np.float64) - b) ** 2).mean()), 1e-30))


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


def test_what_is_hidden_by_a_wall_is_not_drawn(case: Callable) -> None:
    many = case(40_000, scale_m=0.02, seed=8)
    cloud = {name: value.detach()[spatial_order(many.parameters["means_m"].detach().numpy())].clone()
             for name, value in many.parameters.items()}  # fmt: skip
    free = len(rasterize(**cloud, **many.camera).visibility.index)
    near = torch.linalg.norm(cloud["means_m"] - many.T_world_camera[:3, 3].detach().float(), dim=1) < 1.5
    cloud["scales_m"][near], cloud["opacities"][near] = 0.5, 0.99
    behind = rasterize(**cloud, **many.camera)
    assert float(behind.alpha.detach().min()) > 0.999
    assert len(behind.visibility.index) < free // 2


def test_nothing_in_view_is_transparent_and_black(case: Callable) -> None:
    small = case(features=2)
    with torch.no_grad():
        small.parameters["means_m"] -= 100.0 * small.T_world_camera[:3, 2].float()
    rendered = rasterize(**small.parameters, **small.camera, background=torch.tensor([0.1, 0.2, 0.3]))
    assert torch.isinf(rendered.depth_m).all()
    assert not rendered.features.any()
    torch.testing.assert_close(rendered.rgb[5, 5], torch.tensor([0.1, 0.2, 0.3]))
    (rendered.rgb.sum() + rendered.alpha.sum()).backward()
    assert not any(gradient.any() for gradient in small.gradients().values())


def test_works_without_colour(case: Callable) -> None:
    small = case(features=2)
    del small.parameters["sh"]
    rendered = rasterize(**small.parameters, **small.camera)
    assert rendered.rgb is None
    (rendered.features.sum() + rendered.alpha.sum()).backward()
    assert all(gradient.any() for gradient in small.gradients().values())


def test_gradients_of_two_views_add_up(case: Callable, loss: Callable) -> None:
    """Both views are alive at once, and their memory is not mixed up."""
    both, first, second = (case(400, features=3) for _ in range(3))
    other_pose = case(400, yaw=0.9).T_world_camera.detach()
    views = [rasterize(**both.parameters, **{**both.camera, "T_world_camera": pose})
             for pose in (both.T_world_camera, other_pose)]  # fmt: skip
    (loss(views[0]) + 2.0 * loss(views[1])).backward()
    loss(rasterize(**first.parameters, **first.camera)).backward()
    (2.0 * loss(rasterize(**second.parameters, **{**second.camera, "T_world_camera": other_pose}))).backward()
    for name, value in both.parameters.items():
        expected = first.parameters[name].grad + second.parameters[name].grad
        torch.testing.assert_close(value.grad, expected, rtol=1e-4, atol=1e-5)


def test_gradients_stay_while_they_are_held(case: Callable, loss: Callable) -> None:
    small = case(400)
    loss(rasterize(**small.parameters, **small.camera)).backward()
    held = {name: value.grad for name, value in small.parameters.items()}
    copies = {name: gradient.clone() for name, gradient in held.items()}
    for value in small.parameters.values():
        value.grad = None
    rendered = rasterize(**small.parameters, **small.camera)
    image = rendered.rgb.detach()
    before = image.clone()
    (3.0 * loss(rendered)).backward()
    del rendered
    rasterize(**case(400, seed=5).parameters, **small.camera)
    assert all(torch.equal(held[name], copies[name]) for name in held)
    assert torch.equal(image, before)


def test_a_parameter_changed_before_the_backward_pass_is_an_error(case: Callable) -> None:
    small = case()
    rendered = rasterize(**small.parameters, **small.camera)
    with torch.no_grad():
        small.parameters["means_m"] += 1.0
    with pytest.raises(RuntimeError, match="modified by an inplace operation"):
        rendered.rgb.sum().backward()


def test_images_are_drawn_without_gradients_too(case: Callable) -> None:
    small = case(features=2)
    expected = rasterize(**small.parameters, **small.camera)
    with torch.no_grad():
        rendered = rasterize(**small.parameters, **small.camera)
    assert not rendered.rgb.requires_grad
    assert torch.equal(rendered.rgb, expected.rgb.detach())


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("means_m", torch.zeros(300, 2), r"means_m must be a float32 tensor on the CPU of shape \(300, 3\)"),
        ("scales_m", torch.zeros(300, 3, dtype=torch.float64), "scales_m must be a float32"),
        ("opacities", torch.zeros(299), "opacities must be"),
        ("sh", torch.zeros(300, 5, 3), "sh must have 1, 4, 9 or 16 coefficients, got 5"),
    ],
)
def test_wrong_tensors_are_refused(case: Callable, name: str, value: torch.Tensor, message: str) -> None:
    small = case()
    with pytest.raises(ValueError, match=message):
        rasterize(**{**small.parameters, name: value}, **small.camera)


def test_a_pose_that_is_not_finite_is_refused(case: Callable) -> None:
    small = case()
    with pytest.raises(ValueError, match="T_world_camera must be a finite 4x4 matrix"):
        rasterize(**small.parameters, **{**small.camera, "T_world_camera": torch.full((4, 4), torch.nan)})


def test_memory_is_used_again_only_when_nobody_holds_it() -> None:
    pool = ArrayPool()
    first = pool.take("x", 1000, np.float32)
    place = first.ctypes.data
    view = first.reshape(10, 100)[2:]
    del first
    second = pool.take("x", 1000, np.float32)
    assert second.ctypes.data != place
    tensor = torch.from_numpy(view)
    del view
    assert pool.take("x", 1000, np.float32).ctypes.data not in (place, second.ctypes.data)
    del tensor
    assert pool.take("x", 900, np.float32).ctypes.data == place


def test_spatial_order_brings_neighbours_together() -> None:
    means = np.random.default_rng(0).uniform(size=(4000, 3)).astype(np.float32)
    ordered = means[spatial_order(means)]
    assert (
        np.linalg.norm(np.diff(ordered, axis=0), axis=1).mean()
        < 0.2 * np.linalg.norm(np.diff(means, axis=0), axis=1).mean()
    )


def test_kernels_load_no_torch() -> None:
    script = "import sys, common.rasterizer.differentiable.frame; sys.exit('torch' in sys.modules)"
    root = Path(__file__).parents[4]
    assert subprocess.run([sys.executable, "-c", script], cwd=root, check=False).returncode == 0
