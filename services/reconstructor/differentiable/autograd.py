"""The differentiable rasterizer as a function of torch tensors."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt
import torch

from readygo.common.arrays import Float32Array, Float64Array, Int64Array
from readygo.common.rasterizer.cpu.view import make_view
from readygo.services.reconstructor.differentiable.frame import Frame, FrameGradients, free_frame, zeros
from readygo.services.reconstructor.differentiable.memory import DEPTH, PLANES, RED, TRANSMITTANCE, Cloud

Tensor = torch.Tensor
COEFFICIENTS = (1, 4, 9, 16)


@dataclass(kw_only=True, eq=False)
class Visibility:
    """The n Gaussians that may have touched the image; what comes after the backward pass is None before it."""

    index: Tensor
    """Indices of these Gaussians, ascending, int64, shape (n,)."""
    radius_px: Tensor
    """Larger half side of the box outside of which alpha is below 1/255 [px], shape (n,)."""
    gradient_px: Tensor | None = None
    """Derivatives of the loss by the projected means [1/px], shape (n, 2); what densification looks at."""
    absolute_gradient_px: Tensor | None = None
    """Sums of the pixels' absolute derivatives by the projected means [1/px], if asked for, shape (n, 2)."""
    weight: Tensor | None = None
    """Sum over all pixels of alpha times transmittance; 0: hidden, shape (n,)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Rendered:
    """Images of one view."""

    rgb: Tensor | None
    """Colour over the background, not clipped above 1; None without `sh`, shape (H, W, 3)."""
    features: Tensor | None
    """Features weighted as colours are, over zero, shape (H, W, F)."""
    depth_sum_m: Tensor
    """Depths weighted as colours are, over zero [m], shape (H, W)."""
    transmittance: Tensor
    """What is left of the background, shape (H, W)."""
    visibility: Visibility

    @property
    def alpha(self) -> Tensor:
        """One minus the transmittance that is left, shape (H, W)."""
        return 1.0 - self.transmittance

    @property
    def depth_m(self) -> Tensor:
        """Mean depth along the optical axis, weighted as colours are [m]; inf where nothing is drawn, shape (H, W)."""
        alpha = self.alpha
        something = alpha > 0.0
        return torch.where(something, self.depth_sum_m / torch.where(something, alpha, 1.0), torch.inf)

    def rows_shown(self, pixels_min: float) -> Int64Array:
        """Indices of the Gaussians that cover more than so many pixels, ascending; of an image drawn with gradients."""
        self.transmittance.backward(torch.zeros_like(self.transmittance))  # type: ignore[no-untyped-call]
        assert self.visibility.weight is not None
        rows: Int64Array = self.visibility.index[self.visibility.weight > pixels_min].numpy()
        return rows


@dataclass(frozen=True, kw_only=True, eq=False)
class _Settings:
    K_px: Float64Array
    height_px: int
    width_px: int
    sh_degree: int
    sparse_gradients: bool
    absolute_gradients: bool


def rasterize(
    means_m: Tensor,
    quats_wxyz: Tensor,
    scales_m: Tensor,
    opacities: Tensor,
    sh: Tensor | None = None,
    features: Tensor | None = None,
    *,
    T_world_camera: Tensor,
    K_px: npt.ArrayLike,
    height_px: int,
    width_px: int,
    sh_degree: int = 3,
    background: Tensor | None = None,
    sparse_gradients: bool = False,
    absolute_gradients: bool = False,
) -> Rendered:
    """Draw Gaussians by the rules of `readygo.common.rasterizer.constants`; differentiable by all tensors.

    Runs on one core; the result does not depend on the order of the Gaussians but for equal depths. It is fastest if
    neighbours in space are neighbours in memory, see `spatial_order`. Memory is used again as soon as images and
    gradients of earlier calls are dropped. Several threads may do this side by side, each forward and backward on its
    own; kernels release Python's lock.

    Args:
        means_m: Centres in the world [m], float32, shape (N, 3).
        quats_wxyz: Rotations from principal axes to the world, of any length, shape (N, 4).
        scales_m: Standard deviations along the principal axes [m], linear, shape (N, 3).
        opacities: Peak opacities in 0..1, shape (N,).
        sh: SH coefficients in 3DGS order and sign, shape (N, K, 3), K = 1, 4, 9 or 16.
        features: Any other numbers per Gaussian to be blended like colours, shape (N, F).
        T_world_camera: Camera pose, OpenCV axes, float32 or float64, shape (4, 4). Its inverse is taken as (R^T,
            -R^T p): the gradient by the 12 entries is that of this formula, and is meant for the parameters of a rigid
            motion.
        K_px: Intrinsics [px] without skew, not differentiable, shape (3, 3).
        height_px: Image height.
        width_px: Image width.
        sh_degree: Coefficients of higher degrees are left out, as in the first part of a training.
        background: Colour behind everything, shape (3,); black by default.
        sparse_gradients: Give the gradients by parameters as sparse (COO) tensors with rows for those Gaussians alone
            that have weight in the image (`grad._indices()`, `grad._values()`). Dense ones for large clouds take a
            third longer to make, and many times longer to optimise with.
        absolute_gradients: Also fill `visibility.absolute_gradient_px`.

    Returns:
        Images.

    Raises:
        ValueError: If a tensor has a wrong shape or type, or the pose is not finite.
    """
    parameters = _contiguous_parameters(means_m, quats_wxyz, scales_m, opacities, sh, features)
    pose = _checked_pose(T_world_camera)
    stored = 0 if sh is None else COEFFICIENTS.index(sh.shape[1])
    settings = _Settings(
        K_px=np.asarray(K_px, dtype=np.float64),
        height_px=height_px,
        width_px=width_px,
        sh_degree=min(sh_degree, stored),
        sparse_gradients=sparse_gradients,
        absolute_gradients=absolute_gradients,
    )
    visibility = Visibility(index=torch.empty(0, dtype=torch.int64), radius_px=torch.empty(0))
    colour, drawn, depth, transmittance = _Rasterize.apply(*parameters, pose, settings, visibility)  # type: ignore[no-untyped-call]
    if background is not None and sh is not None:
        colour = colour + transmittance[..., None] * background
    return Rendered(
        rgb=None if sh is None else colour,
        features=None if features is None else drawn,
        depth_sum_m=depth,
        transmittance=transmittance,
        visibility=visibility,
    )


def _contiguous_parameters(*tensors: Tensor | None) -> tuple[Tensor | None, ...]:
    """The parameters, contiguous."""
    names = ("means_m", "quats_wxyz", "scales_m", "opacities", "sh", "features")
    count = 0 if tensors[0] is None else len(tensors[0])
    shapes = ((count, 3), (count, 4), (count, 3), (count,), (count, None, 3), (count, None))
    for name, tensor, shape in zip(names, tensors, shapes, strict=True):
        if tensor is None:
            continue
        fits = tensor.dim() == len(shape) and all(
            want in (None, got) for want, got in zip(shape, tensor.shape, strict=True)
        )
        if not fits or tensor.dtype != torch.float32 or tensor.device.type != "cpu":
            wanted = str(shape).replace("None", "any")
            raise ValueError(
                f"{name} must be a float32 tensor on the CPU of shape {wanted}, "
                f"got {tensor.dtype} {tuple(tensor.shape)} on {tensor.device}."
            )
    if tensors[4] is not None and tensors[4].shape[1] not in COEFFICIENTS:
        raise ValueError(f"sh must have 1, 4, 9 or 16 coefficients, got {tensors[4].shape[1]}.")
    return tuple(None if tensor is None else tensor.contiguous() for tensor in tensors)


def _checked_pose(T_world_camera: Tensor) -> Tensor:
    if T_world_camera.shape != (4, 4) or not bool(torch.isfinite(T_world_camera).all()):
        raise ValueError(f"T_world_camera must be a finite 4x4 matrix, got {T_world_camera.tolist()}.")
    return T_world_camera


def _flat(tensor: Tensor | None) -> Float32Array:
    if tensor is None:
        return np.empty(0, dtype=np.float32)
    array: Float32Array = tensor.detach().numpy().reshape(-1)
    return array


class _Rasterize(torch.autograd.Function):
    """Colour, features, depth times alpha, and transmittance."""

    @staticmethod
    def forward(
        ctx: Any,
        means_m: Tensor,
        quats_wxyz: Tensor,
        scales_m: Tensor,
        opacities: Tensor,
        sh: Tensor | None,
        features: Tensor | None,
        T_world_camera: Tensor,
        settings: _Settings,
        visibility: Visibility,
    ) -> tuple[Tensor, Tensor, Tensor, Tensor]:
        frame = free_frame(settings.height_px, settings.width_px)
        cloud = Cloud(
            _flat(means_m),
            _flat(quats_wxyz),
            _flat(scales_m),
            _flat(opacities),
            _flat(sh),
            0 if sh is None else sh.shape[1] * 3,
            0 if sh is None else COEFFICIENTS[settings.sh_degree],
        )
        pose = T_world_camera.detach().numpy().astype(np.float64)
        view = make_view(pose, settings.K_px, settings.height_px, settings.width_px)
        drawn = None if features is None else features.detach().numpy()
        out = frame.draw(view, cloud, drawn, keep=any(ctx.needs_input_grad))
        visibility.index = torch.from_numpy(out.index)
        visibility.radius_px = torch.from_numpy(out.radius_px)
        ctx.frame, ctx.settings, ctx.visibility = frame, settings, visibility
        ctx.set_materialize_grads(False)
        whole = torch.from_numpy(out.planes)
        # The parameters are saved so that torch notices when one is changed before the backward pass.
        saved = [means_m, quats_wxyz, scales_m, opacities, sh, features, T_world_camera]
        ctx.save_for_backward(whole, torch.from_numpy(out.token), *saved)
        images = whole[:, : settings.height_px, : settings.width_px]
        return (
            images[RED : RED + 3].permute(1, 2, 0),
            images[PLANES : PLANES + (0 if drawn is None else drawn.shape[1])].permute(1, 2, 0),
            images[DEPTH],
            images[TRANSMITTANCE],
        )

    @staticmethod
    def backward(ctx: Any, *slopes: Tensor | None) -> tuple[Tensor | None, ...]:
        whole, _, means_m, _, _, _, _, _, pose = ctx.saved_tensors
        frame: Frame = ctx.frame
        settings: _Settings = ctx.settings
        padded = frame.zero_planes()
        images = torch.from_numpy(padded)[:, : settings.height_px, : settings.width_px]
        colour, drawn, depth, transmittance = slopes
        if colour is not None:
            images[RED : RED + 3] = colour.permute(2, 0, 1)
        if drawn is not None:
            images[PLANES : PLANES + drawn.shape[2]] = drawn.permute(2, 0, 1)
        if depth is not None:
            images[DEPTH] = depth
        if transmittance is not None:
            images[TRANSMITTANCE] = transmittance
        dense = not settings.sparse_gradients
        out = frame.derive(
            whole.numpy(),
            padded,
            absolute=settings.absolute_gradients,
            dense=dense,
        )
        visibility: Visibility = ctx.visibility
        visibility.gradient_px = torch.from_numpy(out.means_px)
        visibility.weight = torch.from_numpy(out.weights)
        if out.absolute_px is not None:
            visibility.absolute_gradient_px = torch.from_numpy(out.absolute_px)
        rows = _Rows(torch.from_numpy(out.index), len(means_m), dense)
        return (
            rows.tensor("means_m", out.means_m),
            rows.tensor("quats_wxyz", out.quats_wxyz),
            rows.tensor("scales_m", out.scales_m),
            rows.tensor("opacities", out.opacities),
            torch.from_numpy(out.sh) if dense and out.sh is not None else rows.tensor("sh", out.sh),
            rows.tensor("features", out.features),
            _pose_gradient(out).to(pose.dtype),
            None,
            None,
        )


@dataclass(frozen=True)
class _Rows:
    """Turns rows of the Gaussians `index` into gradients of all N."""

    index: Tensor
    count: int
    dense: bool

    def tensor(self, name: str, rows: Float32Array | None) -> Tensor | None:
        if rows is None:
            return None
        values, shape = torch.from_numpy(rows), (self.count, *rows.shape[1:])
        if self.dense:
            return torch.from_numpy(zeros(f"dense_{name}", shape)).index_copy_(0, self.index, values)
        return torch.sparse_coo_tensor(self.index[None], values, shape, is_coalesced=True, check_invariants=False)


def _pose_gradient(out: FrameGradients) -> Tensor:
    gradient = torch.zeros((4, 4), dtype=torch.float64)
    gradient[:3, :3] = torch.from_numpy(out.R_CW.T.copy())
    gradient[:3, 3] = torch.from_numpy(out.p_WC)
    return gradient
