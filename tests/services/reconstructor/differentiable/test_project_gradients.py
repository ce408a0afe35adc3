"""Derivatives by what is projected."""

from collections.abc import Callable

import torch

from readygo.services.reconstructor.differentiable.autograd import rasterize
from tests.services.reconstructor.differentiable.comparison import RELATIVE, draw_both


def test_gradients_by_projected_means_equal_those_of_the_reference(case: Callable, loss: Callable) -> None:
    small = case(features=2)
    fast_image, slow_image, _, _ = draw_both(small, loss)
    expected = torch.zeros(len(small.parameters["means_m"]), 2, dtype=torch.float64)
    expected[slow_image.index] = slow_image.means_px.grad
    visibility = fast_image.visibility
    found = torch.zeros_like(expected)
    found[visibility.index] = visibility.gradient_px.double()
    assert (found - expected).norm() <= RELATIVE * expected.norm()


def test_gaussians_that_are_not_seen_get_zero_gradients(case: Callable, loss: Callable) -> None:
    small = case(features=1)
    with torch.no_grad():
        small.parameters["means_m"][:10] = small.T_world_camera[:3, 3].float() - 2 * small.T_world_camera[:3, 2].float()
        small.parameters["opacities"][10:20] = 0.001
        small.parameters["scales_m"][20] = 0.0
        small.parameters["quats_wxyz"][21] = 0.0
        small.parameters["means_m"][22] = float("nan")
    rendered = rasterize(**small.parameters, **small.camera)
    loss(rendered).backward()
    assert torch.isfinite(rendered.rgb).all()
    for name, gradient in small.gradients().items():
        assert torch.isfinite(gradient).all(), name
    assert not small.parameters["means_m"].grad[:20].any()
    assert not small.parameters["sh"].grad[:20].any()
