"""What a training asks of gsplat, with the CPU's rasterizer in its place."""

import numpy as np
import pytest
import torch

from readygo.common.rasterizer.constants import ALPHA_MAX
from readygo.services.reconstructor.differentiable.reference import rasterize_with_torch
from readygo.services.reconstructor.training.gsplat_values import Blended, blend_values
from tests.common.rasterizer.gpu.differentiable_rasterization import DifferentiableRasterization

SIZE_PX = (20, 28)
K = np.array([[30.0, 0.0, 14.0], [0.0, 31.0, 10.0], [0.0, 0.0, 1.0]])


def pose() -> np.ndarray:
    T = np.eye(4)
    T[:3, 3] = [0.1, -0.2, -0.3]
    return T


def gaussians(count: int = 40) -> dict[str, torch.Tensor]:
    rng = np.random.default_rng(0)
    arrays = {
        "means_m": rng.uniform([-1.0, -0.7, 1.5], [1.0, 0.7, 3.0], (count, 3)),
        "quats_wxyz": rng.normal(size=(count, 4)),
        "scales_m": rng.uniform(0.03, 0.3, (count, 3)),
        "opacities": rng.uniform(0.2, 0.9, count),
        "values": rng.normal(size=(count, 4)),
    }
    return {name: torch.tensor(array, dtype=torch.float32, requires_grad=True) for name, array in arrays.items()}


def blended(parameters: dict[str, torch.Tensor]) -> Blended:
    return blend_values(
        DifferentiableRasterization(), **parameters, T_world_camera=pose(), K_px=K, size_px=SIZE_PX, absolute=True
    )


def test_values_and_gradients_are_those_of_the_reference() -> None:
    parameters, slope = gaussians(), torch.randn((*SIZE_PX, 4), generator=torch.Generator().manual_seed(1))
    drawn = blended(parameters)
    ((drawn.values * slope).sum() + drawn.nothing).backward()
    exact = {name: tensor.detach().double().requires_grad_() for name, tensor in parameters.items()}
    features = exact.pop("values")
    reference = rasterize_with_torch(
        **exact,
        features=features,
        T_world_camera=torch.tensor(pose()),
        K_px=K,
        height_px=SIZE_PX[0],
        width_px=SIZE_PX[1],
    )
    assert reference.features is not None
    (reference.features * slope).sum().backward()
    np.testing.assert_allclose(drawn.values.detach(), reference.features.detach(), atol=2e-5)
    np.testing.assert_allclose(drawn.alpha.detach(), reference.alpha.detach(), atol=2e-5)
    for name, tensor in {**exact, "values": features}.items():
        found, wanted = parameters[name].grad, tensor.grad
        assert found is not None
        assert wanted is not None
        np.testing.assert_allclose(found, wanted, atol=2e-4 * float(wanted.abs().max()), err_msg=name)
    assert reference.means_px.grad is not None
    moved = torch.zeros(len(found), 2, dtype=torch.float64)
    moved[reference.index] = reference.means_px.grad
    np.testing.assert_allclose(drawn.gradient_px(absolute=False), moved, atol=2e-4 * float(moved.abs().max()))
    assert (drawn.gradient_px(absolute=True) >= drawn.gradient_px(absolute=False).abs() - 1e-4).all()


def test_weights_are_sums_of_what_a_gaussian_adds() -> None:
    parameters = gaussians()
    drawn = blended(parameters)
    drawn.nothing.backward()
    assert float(drawn.nothing.detach()) == 0.0
    assert float(drawn.weight.sum()) == pytest.approx(float(drawn.alpha.detach().sum()), rel=1e-4)
    for name in ("means_m", "quats_wxyz", "scales_m", "opacities"):
        gradient = parameters[name].grad
        assert gradient is not None
        assert not gradient.any(), name


def test_opacities_are_drawn_capped_and_learned_as_they_are() -> None:
    kernels, parameters = DifferentiableRasterization(), gaussians()
    with torch.no_grad():
        parameters["opacities"][:] = 0.999
    drawn = blend_values(kernels, **parameters, T_world_camera=pose(), K_px=K, size_px=SIZE_PX)
    assert float(kernels.calls[0]["opacities"].detach().max()) == pytest.approx(ALPHA_MAX)
    drawn.values.square().sum().backward()
    assert parameters["opacities"].grad is not None
    assert parameters["opacities"].grad.any()
