"""Spherical harmonics and their derivatives."""

from collections.abc import Callable

from readygo.services.reconstructor.differentiable.autograd import rasterize
from tests.services.reconstructor.differentiable.comparison import assert_close, draw_both


def test_lower_degree_leaves_higher_coefficients_out(case: Callable, loss: Callable) -> None:
    small = case()
    _, _, fast, slow = draw_both(small, loss, sh_degree=1)
    assert_close(fast, slow)
    assert not fast["sh"][:, 4:].any()


def test_works_without_colour(case: Callable) -> None:
    small = case(features=2)
    del small.parameters["sh"]
    rendered = rasterize(**small.parameters, **small.camera)
    assert rendered.rgb is None
    (rendered.features.sum() + rendered.alpha.sum()).backward()
    assert all(gradient.any() for gradient in small.gradients().values())
