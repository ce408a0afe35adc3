"""The rasterizer as a function of tensors: its gradients, and what it refuses."""

from collections.abc import Callable

import numpy as np
import pytest
import torch

from readygo.services.reconstructor.differentiable.autograd import rasterize
from tests.services.reconstructor.differentiable.comparison import RELATIVE, assert_close, draw_both


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


def test_rows_that_are_shown_cover_more_than_some_pixels(case: Callable) -> None:
    drawn = case(900)
    rows = rasterize(**drawn.parameters, **drawn.camera).rows_shown(0.5)
    rendered = rasterize(**drawn.parameters, **drawn.camera)
    rendered.alpha.sum().backward()
    visibility = rendered.visibility
    assert rows.tolist() == visibility.index[visibility.weight > 0.5].tolist()
    assert 0 < len(rows) < int((visibility.weight > 0).sum())


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
