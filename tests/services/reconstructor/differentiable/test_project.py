"""What the differentiable rasterizer projects."""

from collections.abc import Callable

import numpy as np
import pytest
import torch
from numba import njit

from readygo.common.simd.memory import load_f16, store_f16
from readygo.services.reconstructor.differentiable.autograd import rasterize
from readygo.services.reconstructor.differentiable.order import spatial_order
from readygo.services.reconstructor.differentiable.project import _log2


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


@njit
def _log2_of(x, out):
    store_f16(out, 0, _log2(load_f16(x, 0)))


def test_logarithm_is_as_exact_as_float32() -> None:
    x, out = np.geomspace(1 / 255, 1.0, 16).astype(np.float32), np.empty(16, np.float32)
    _log2_of(x, out)
    assert out == pytest.approx(np.log2(x.astype(np.float64)), abs=6e-7)


def test_drawn_gaussians_are_listed_in_the_order_of_memory(case: Callable) -> None:
    """Chunks come in slabs of depth, so that their groups are in another order."""
    many = case(30_000, scale_m=0.02, seed=8)
    visibility = rasterize(**many.parameters, **many.camera).visibility
    assert len(visibility.index) > 1000
    assert (visibility.index.diff() > 0).all()
    assert len(visibility.radius_px) == len(visibility.index)
    # Of the larger ones, the radius is that of the box outside of which alpha is below its threshold.
    number = visibility.index[visibility.radius_px.argmax()]
    one = {name: value.detach()[number : number + 1] for name, value in many.parameters.items()}
    alpha = rasterize(**one, **many.camera).alpha
    rows, columns = (alpha > 0).nonzero(as_tuple=True)
    widest = max(int(columns.max() - columns.min()), int(rows.max() - rows.min())) + 1
    assert 2 * float(visibility.radius_px.max()) >= widest - 1
