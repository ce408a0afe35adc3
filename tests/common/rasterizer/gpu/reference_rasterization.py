"""What stands in for gsplat in tests: the reference behind gsplat's entry."""

from typing import Any

import numpy as np
import pytest
import torch

from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.rasterizer.gpu import gsplat_kernels, rasterizer
from readygo.common.rasterizer.reference import rasterize_reference


class ReferenceRasterization:
    """Takes gsplat's arguments, and draws with the reference."""

    def __init__(self) -> None:
        self.calls: list[dict[str, Any]] = []

    def __call__(self, **args: Any) -> tuple[torch.Tensor, torch.Tensor, dict[str, Any]]:
        self.calls.append(args)
        images = [self._draw(args, k) for k in range(len(args["viewmats"]))]
        depth = [torch.from_numpy(np.where(i.alpha > 0, i.depth_m, 0) * i.alpha) for i in images]
        colours = torch.stack([torch.from_numpy(i.rgb) for i in images])
        if args["render_mode"] == "RGB+D":
            colours = torch.cat([colours, torch.stack(depth)[..., None]], dim=-1)
        return colours, torch.stack([torch.from_numpy(i.alpha) for i in images])[..., None], {}

    @staticmethod
    def _draw(args: dict[str, Any], camera: int) -> Any:
        colours = args["colors"]
        # Colours per camera come without degree, and are no coefficients.
        sh = colours if args["sh_degree"] is not None else ((colours[camera] - 0.5) / SH_C0)[:, None]
        cloud = GaussianCloud(
            means_m=args["means"].numpy(),
            quats_wxyz=args["quats"].numpy(),
            scales_m=args["scales"].numpy(),
            opacities=args["opacities"].numpy(),
            sh=sh.numpy(),
        )
        T = np.linalg.inv(args["viewmats"][camera].double().numpy())
        return rasterize_reference(cloud, T, args["Ks"][camera].numpy(), args["height"], args["width"])


def stand_in_for_gsplat(monkeypatch: pytest.MonkeyPatch) -> ReferenceRasterization:
    """Have the backend gsplat draw with the reference, on any machine."""
    fake = ReferenceRasterization()
    monkeypatch.setattr(gsplat_kernels, "gsplat_rasterization", lambda: fake)
    monkeypatch.setattr(rasterizer, "require_kernels", lambda kernels, device: None)
    return fake
