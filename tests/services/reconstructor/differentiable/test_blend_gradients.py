"""Derivatives by what is blended."""

import math
from collections.abc import Callable

import torch

from readygo.services.reconstructor.differentiable.autograd import rasterize


def test_absolute_gradients_are_those_of_single_pixels_summed_up(case: Callable) -> None:
    small = case(120, height_px=6, width_px=8, features=6, scale_m=0.1)
    rendered = rasterize(**small.parameters, **small.camera, absolute_gradients=True)
    weights = torch.randn(rendered.rgb.shape, generator=torch.Generator().manual_seed(1))
    (rendered.rgb * weights).sum().backward()
    index = rendered.visibility.index
    total = torch.zeros(len(index), 2)
    for row in range(6):
        for column in range(8):
            single = rasterize(**small.parameters, **small.camera)
            (single.rgb * weights)[row, column].sum().backward()
            assert torch.equal(single.visibility.index, index)
            total += single.visibility.gradient_px.abs()
    torch.testing.assert_close(rendered.visibility.absolute_gradient_px, total, rtol=1e-3, atol=1e-5)


def test_weights_sum_up_to_the_images_alpha(case: Callable) -> None:
    rendered = rasterize(**(small := case(2000)).parameters, **small.camera)
    rendered.rgb.sum().backward()
    assert math.isclose(float(rendered.visibility.weight.sum()), float(rendered.alpha.detach().sum()), rel_tol=1e-4)
    assert (rendered.visibility.radius_px[rendered.visibility.weight > 0] > 0).all()


def test_gradients_are_the_same_bytes_again(case: Callable, loss: Callable) -> None:
    drawn = []
    for _ in range(2):
        loss(rasterize(**(small := case(900, features=5)).parameters, **small.camera)).backward()
        drawn.append(small.gradients())
    assert all(torch.equal(drawn[0][name], drawn[1][name]) for name in drawn[0])
