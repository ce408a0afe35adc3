"""What stands in for gsplat in tests of trainings: the differentiable rasterizer of the CPU behind gsplat's entry."""

from typing import Any

import numpy as np
import torch

from readygo.services.reconstructor.differentiable.autograd import rasterize


class _Drawn(torch.autograd.Function):
    """Draws values, and says of projected means what gsplat says of them after the backward pass."""

    @staticmethod
    def forward(ctx: Any, means_px: torch.Tensor, args: dict[str, Any], *shapes: torch.Tensor) -> Any:
        leaves = [shape.detach().requires_grad_() for shape in shapes]
        means_m, quats_wxyz, scales_m, opacities, values = leaves
        with torch.enable_grad():
            drawn = rasterize(
                means_m,
                quats_wxyz,
                scales_m,
                opacities,
                features=values,
                T_world_camera=torch.linalg.inv(args["viewmats"][0].double()),
                K_px=args["Ks"][0].double().numpy(),
                height_px=args["height"],
                width_px=args["width"],
                absolute_gradients=args["absgrad"],
            )
        ctx.means_px, ctx.leaves, ctx.drawn = means_px, leaves, drawn
        assert drawn.features is not None
        return drawn.features.detach()[None].clone(), drawn.alpha.detach()[None, ..., None].clone()

    @staticmethod
    def backward(ctx: Any, by_values: torch.Tensor, by_alpha: torch.Tensor) -> Any:
        assert not by_alpha.any()
        gradients = torch.autograd.grad(ctx.drawn.features, ctx.leaves, by_values[0], allow_unused=True)
        seen, count = ctx.drawn.visibility, len(ctx.leaves[0])
        whole = {}
        for name, rows in (("sum", seen.gradient_px), ("absolute", seen.absolute_gradient_px)):
            whole[name] = torch.zeros(1, count, 2)
            if rows is not None:
                whole[name][0, seen.index] = rows
        ctx.means_px.absgrad = whole["absolute"]
        return whole["sum"], None, *gradients


class DifferentiableRasterization:
    """Takes the arguments that a training gives gsplat."""

    def __init__(self) -> None:
        self.calls: list[dict[str, Any]] = []

    def __call__(self, **args: Any) -> tuple[torch.Tensor, torch.Tensor, dict[str, Any]]:
        self.calls.append(args)
        assert args["sh_degree"] is None
        assert not args["packed"]
        assert np.shape(args["viewmats"]) == (1, 4, 4)
        names = ("means", "quats", "scales", "opacities", "colors")
        means_px = torch.zeros(1, len(args["means"]), 2, requires_grad=True)
        values, alpha = _Drawn.apply(means_px, args, *(args[name] for name in names))  # type: ignore[no-untyped-call]
        return values, alpha, {"means2d": means_px}
