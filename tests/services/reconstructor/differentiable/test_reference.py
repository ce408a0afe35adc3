"""The torch reference next to finite differences and to the NumPy reference."""

from collections.abc import Callable

import numpy as np
import torch

from readygo.common.rasterizer.reference import rasterize_reference
from readygo.services.reconstructor.differentiable.reference import rasterize_with_torch


def test_gradients_are_those_of_finite_differences(case: Callable, loss: Callable) -> None:
    """Along random directions; steps are too small to move an alpha across its threshold in this case."""
    small = case(12, height_px=6, width_px=8, scale_m=0.3, features=2, opacity=(0.3, 0.8)).doubled()
    loss(rasterize_with_torch(**small.parameters, **small.camera)).backward()
    generator = torch.Generator().manual_seed(0)
    for name, gradient in small.gradients().items():
        value = small.T_world_camera if name == "pose" else small.parameters[name]
        direction = torch.randn(value.shape, generator=generator, dtype=torch.float64)
        if name == "pose":
            direction[3] = 0.0
        start, ends = value.detach().clone(), []
        for step in (-1e-6, 1e-6):
            with torch.no_grad():
                value.copy_(start + step * direction)
                ends.append(float(loss(rasterize_with_torch(**small.parameters, **small.camera))))
                value.copy_(start)
        expected = (ends[1] - ends[0]) / 2e-6
        np.testing.assert_allclose(float((gradient * direction).sum()), expected, rtol=1e-4, err_msg=name)


def test_images_are_those_of_the_numpy_reference(case: Callable) -> None:
    small = case(500)
    rendered = rasterize_with_torch(**small.doubled().parameters, **small.camera)
    expected = rasterize_reference(small.cloud(), small.T_world_camera.detach().numpy(), small.K_px, 36, 52)
    np.testing.assert_allclose(rendered.rgb.detach().numpy(), expected.rgb, atol=1e-6)
    np.testing.assert_allclose(rendered.alpha.detach().numpy(), expected.alpha, atol=1e-6)
