"""What the differentiable rasterizer projects."""

from collections.abc import Callable

import torch

from readygo.common.rasterizer.differentiable.autograd import rasterize
from readygo.common.rasterizer.differentiable.order import spatial_order


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
