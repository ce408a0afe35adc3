"""Gradients next to float64 autograd of the reference."""

import math
from collections.abc import Callable

import numpy as np
import pytest
import torch

from readygo.common.rasterizer.differentiable.autograd import Rendered, rasterize
from readygo.common.rasterizer.differentiable.reference import ReferenceRendered, rasterize_with_torch

RELATIVE = 1e-3


def draw_both(case, loss, **options) -> tuple[Rendered, ReferenceRendered, dict, dict]:
    slow = case.doubled()
    fast_image = rasterize(**case.parameters, **case.camera, **options)
    loss(fast_image).backward()
    if options.get("background") is not None:
        options["background"] = options["background"].double()
    slow_image = rasterize_with_torch(**slow.parameters, **slow.camera, **options)
    loss(slow_image).backward()
    return fast_image, slow_image, case.gradients(), slow.gradients()


def assert_close(fast: dict, slow: dict) -> None:
    for name, expected in slow.items():
        assert torch.isfinite(fast[name]).all(), name
        error = (fast[name] - expected).norm() / expected.norm()
        assert error <= RELATIVE, f"{name}: {error:.2e}"


@pytest.mark.parametrize(
    "options",
    [
        pytest.param({"features": 3}, id="normals"),
        pytest.param({"features": 4, "yaw": 2.5, "seed": 1}, id="one full group of features"),
        pytest.param({"features": 9, "seed": 2, "yaw": -2.0}, id="several groups of features"),
        pytest.param({"scale_m": 0.002, "count": 2000, "opacity": (0.5, 1.0)}, id="tiny"),
        pytest.param({"scale_m": 0.6, "count": 60, "seed": 4}, id="large, beyond the image and across the near plane"),
        pytest.param({"count": 3000, "scale_m": 0.1, "opacity": (0.7, 1.0)}, id="saturated pixels and capped alphas"),
        pytest.param({"coefficients": 9, "seed": 5}, id="degree 2"),
        pytest.param({"coefficients": 4, "seed": 6}, id="degree 1"),
        pytest.param({"coefficients": 1, "seed": 7, "height_px": 40, "width_px": 33}, id="degree 0, odd size"),
    ],
)
def test_gradients_equal_those_of_the_reference(case: Callable, loss: Callable, options: dict) -> None:
    fast_image, slow_image, fast, slow = draw_both(case(**options), loss, background=torch.tensor([0.2, 0.5, 0.9]))
    assert (fast_image.rgb - slow_image.rgb).abs().max() < 1e-3
    assert_close(fast, slow)


def test_lower_degree_leaves_higher_coefficients_out(case: Callable, loss: Callable) -> None:
    small = case()
    _, _, fast, slow = draw_both(small, loss, sh_degree=1)
    assert_close(fast, slow)
    assert not fast["sh"][:, 4:].any()


def test_gradients_by_projected_means_equal_those_of_the_reference(case: Callable, loss: Callable) -> None:
    small = case(features=2)
    fast_image, slow_image, _, _ = draw_both(small, loss)
    expected = torch.zeros(len(small.parameters["means_m"]), 2, dtype=torch.float64)
    expected[slow_image.index] = slow_image.means_px.grad
    visibility = fast_image.visibility
    found = torch.zeros_like(expected)
    found[visibility.index] = visibility.gradient_px.double()
    assert (found - expected).norm() <= RELATIVE * expected.norm()


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


def test_sparse_gradients_hold_the_rows_of_the_dense_ones(case: Callable, loss: Callable) -> None:
    dense, sparse = case(900, features=5), case(900, features=5)
    loss(rasterize(**dense.parameters, **dense.camera)).backward()
    rendered = rasterize(**sparse.parameters, **sparse.camera, sparse_gradients=True)
    loss(rendered).backward()
    for name, parameter in sparse.parameters.items():
        assert parameter.grad.is_sparse
        visibility = rendered.visibility
        assert torch.equal(parameter.grad._indices()[0], visibility.index[visibility.weight > 0])
        assert torch.equal(parameter.grad.to_dense(), dense.parameters[name].grad), name


def test_order_in_memory_does_not_matter(case: Callable, loss: Callable) -> None:
    """More than a chunk of Gaussians, in slabs or not."""
    straight, shuffled = case(40_000, scale_m=0.02, seed=8), case(40_000, scale_m=0.02, seed=8)
    order = torch.from_numpy(np.random.default_rng(0).permutation(40_000))
    along = torch.argsort(straight.parameters["means_m"][:, 0].detach())
    for name, value in straight.parameters.items():
        straight.parameters[name] = value.detach()[along].requires_grad_()
        shuffled.parameters[name] = value.detach()[order].requires_grad_()
    images = []
    for one in (straight, shuffled):
        rendered = rasterize(**one.parameters, **one.camera)
        loss(rendered).backward()
        images.append(rendered.rgb)
    torch.testing.assert_close(images[0], images[1], rtol=0, atol=2e-4)
    for name, value in straight.parameters.items():
        back, forth = torch.empty_like(value), torch.empty_like(value)
        back[along], forth[order] = value.grad, shuffled.parameters[name].grad
        assert (back - forth).norm() <= RELATIVE * back.norm(), name


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
