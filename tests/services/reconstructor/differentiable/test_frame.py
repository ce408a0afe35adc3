"""Memory of views between their passes."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import torch

from readygo.services.reconstructor.differentiable.autograd import rasterize


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


def test_kernels_load_no_torch() -> None:
    script = "import sys, readygo.services.reconstructor.differentiable.frame; sys.exit('torch' in sys.modules)"
    root = Path(__file__).parents[4]
    assert subprocess.run([sys.executable, "-c", script], cwd=root, check=False).returncode == 0
