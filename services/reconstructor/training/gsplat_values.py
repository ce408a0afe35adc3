"""Any numbers of Gaussians, blended by gsplat's kernels for torch to derive: what a training draws with.

gsplat 1.5.3 caps alpha at 0.999, `readygo.common.rasterizer.constants` at 0.99: opacities are capped there instead, but
not what they learn.

Source: gsplat 1.5.3, `gsplat/rendering.py` (arguments, `means2d` with `absgrad`).
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import torch

from readygo.common.arrays import Float64Array
from readygo.common.rasterizer.constants import ALPHA_MAX, DILATION_PX2, NEAR_M
from readygo.common.rasterizer.gpu.gsplat_kernels import FAR_M, TILE_PX, Rasterization

Tensor = torch.Tensor


@dataclass(frozen=True, kw_only=True, eq=False)
class Blended:
    """Images of one view of N Gaussians."""

    values: Tensor
    """Values weighted with alpha and transmittance, over zero, shape (H, W, D)."""
    alpha: Tensor
    """One minus the transmittance that is left, shape (H, W)."""
    nothing: Tensor
    """0. `weight` is known after the backward pass of what this is added to, which it does not change."""
    _probe: Tensor
    _means_px: Any

    @property
    def weight(self) -> Tensor:
        """Sum over all pixels of each Gaussian's alpha times transmittance; 0: hidden, shape (N,)."""
        assert self._probe.grad is not None
        return self._probe.grad[:, 0]

    def gradient_px(self, *, absolute: bool) -> Tensor:
        """Derivatives of the loss by the projected means [1/px], or the sums of their absolute values, shape (N, 2)."""
        gradient: Tensor = self._means_px.absgrad if absolute else self._means_px.grad
        return gradient[0]


def blend_values(
    rasterization: Rasterization,
    *,
    means_m: Tensor,
    quats_wxyz: Tensor,
    scales_m: Tensor,
    opacities: Tensor,
    values: Tensor,
    T_world_camera: Float64Array,
    K_px: Float64Array,
    size_px: tuple[int, int],
    absolute: bool = False,
) -> Blended:
    """Blend values of N Gaussians in one view, differentiable by all tensors.

    Args:
        rasterization: `gsplat.rasterization`.
        means_m: Centres in the world [m], shape (N, 3).
        quats_wxyz: Rotations from principal axes to the world, of any length, shape (N, 4).
        scales_m: Standard deviations [m], shape (N, 3).
        opacities: In 0..1, shape (N,).
        values: Shape (N, D). D = 3, 4 and 7 need no padding of the kernels' channels.
        T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
        K_px: Intrinsics [px] without skew, shape (3, 3).
        size_px: Rows and columns.
        absolute: Also sum up the pixels' absolute derivatives by the projected means.
    """
    # A value of zero that every pixel wants to grow: its derivative is the Gaussian's weight, and no other one changes.
    probe = means_m.new_zeros((len(means_m), 1)).requires_grad_()
    T_camera_world = np.linalg.inv(T_world_camera)
    images, alpha, meta = rasterization(
        means=means_m,
        quats=quats_wxyz,
        scales=scales_m,
        opacities=opacities - (opacities - opacities.clamp(max=ALPHA_MAX)).detach(),
        colors=torch.cat([values, probe], dim=1),
        viewmats=torch.tensor(T_camera_world[None], dtype=torch.float32, device=means_m.device),
        Ks=torch.tensor(K_px[None], dtype=torch.float32, device=means_m.device),
        width=size_px[1],
        height=size_px[0],
        near_plane=NEAR_M,
        far_plane=FAR_M,
        eps2d=DILATION_PX2,
        sh_degree=None,
        packed=False,
        tile_size=TILE_PX,
        absgrad=absolute,
        render_mode="RGB",
    )
    means_px = meta["means2d"]
    if means_px.requires_grad:
        means_px.retain_grad()
    return Blended(
        values=images[0, ..., :-1],
        alpha=alpha[0, ..., 0],
        nothing=images[0, ..., -1].sum(),
        _probe=probe,
        _means_px=means_px,
    )
