"""One view of the Gaussians in training: the loss and its gradients, or the picture alone."""

import threading
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import torch

from readygo.common.rasterizer.differentiable.autograd import Rendered, rasterize
from readygo.services.reconstructor.training.config import GaussiansConfig
from readygo.services.reconstructor.training.parameters import Array, Gaussians, Rows
from readygo.services.reconstructor.training.photometric import Photometric
from readygo.services.reconstructor.training.photos import Photo

Leaves = dict[str, torch.Tensor]


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewGradients:
    """What one view wants."""

    loss: float
    rows: Rows
    """The Gaussians with weight in the image, ascending, shape (n,)."""
    gradients: dict[str, Array]
    """Rows of the parameters' gradients, shape (n, K)."""
    moved: Array
    """Absolute gradients of the projected means of the same, for an image of 2x2 units, shape (n,)."""
    exposure: Array
    """By the logarithms of the image's gains and by its offsets, shape (2, 3)."""


class _Losses(threading.local):
    """A loss and its memory for each thread."""

    def __init__(self) -> None:
        self._size, self._loss = (0, 0), Photometric(0, 0)

    def of(self, size: tuple[int, int]) -> Photometric:
        if size != self._size:
            self._size, self._loss = size, Photometric(*size)
        return self._loss


_LOSSES = _Losses()


def leaves_of(gaussians: Gaussians) -> Leaves:
    """What the rasterizer is given, without gradients yet; means, quaternions and colours share the parameters' memory."""
    arrays = {
        "means_m": gaussians.values["means_m"],
        "quats_wxyz": gaussians.values["quats_wxyz"],
        "scales_m": gaussians.scales_m,
        "opacities": gaussians.opacities,
        "sh": gaussians.values["sh"].reshape(len(gaussians), -1, 3),
    }
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def draw(leaves: Leaves, photo: Photo, sh_degree: int, *, gradients: bool = False) -> Rendered:
    """Draw the view of a photo."""
    return rasterize(
        **leaves,
        T_world_camera=torch.from_numpy(photo.T_world_camera),
        K_px=photo.K_px,
        height_px=photo.rgb.shape[1],
        width_px=photo.rgb.shape[2],
        sh_degree=sh_degree,
        sparse_gradients=gradients,
        absolute_gradients=gradients,
    )


def planes_of(rendered: Rendered) -> Array:
    """The colours of an image, shape (3, H, W)."""
    assert rendered.rgb is not None
    planes: Array = rendered.rgb.detach().permute(2, 0, 1).contiguous().numpy()
    return planes


def view_gradients(
    leaves: Leaves, photo: Photo, exposure: Array, sh_degree: int, settings: GaussiansConfig
) -> ViewGradients:
    """Loss and gradients of one view.

    Args:
        leaves: See `leaves_of`.
        photo: What the view looks like.
        exposure: Logarithms of the image's gains, and offsets, shape (2, 3).
        sh_degree: Higher degrees are left out.
        settings: Weights of the losses.
    """
    leaves = {name: leaf.detach().requires_grad_() for name, leaf in leaves.items()}
    rendered = draw(leaves, photo, sh_degree, gradients=True)
    planes = planes_of(rendered)
    gains, offsets = np.exp(exposure[0])[:, None, None], exposure[1][:, None, None]
    loss, _, slope = _LOSSES.of(planes.shape[1:])(planes * gains + offsets, photo.rgb, settings.ssim_weight)
    by_exposure = np.stack([(slope * planes * gains).sum(axis=(1, 2)), slope.sum(axis=(1, 2))])
    assert rendered.rgb is not None
    rendered.rgb.backward(torch.from_numpy(slope * gains).permute(1, 2, 0))
    rows, gradients = _parameter_gradients(leaves, settings)
    return ViewGradients(
        loss=loss, rows=rows, gradients=gradients, moved=_moved(rendered, planes.shape), exposure=by_exposure
    )


def _parameter_gradients(leaves: Leaves, settings: GaussiansConfig) -> tuple[Rows, dict[str, Array]]:
    """Gradients by what is stored: logarithms of scales, logits of opacities."""
    sparse = {name: leaf.grad for name, leaf in leaves.items()}
    rows = sparse["means_m"]._indices()[0].numpy()
    slopes = {name: gradient._values().numpy() for name, gradient in sparse.items()}
    scales, opacities = leaves["scales_m"].detach().numpy()[rows], leaves["opacities"].detach().numpy()[rows]
    by_opacity, by_scale = slopes["opacities"], slopes["scales_m"]
    if settings.density.method == "mcmc":
        regular = np.float32(settings.density.regular / len(leaves["opacities"]))
        by_opacity, by_scale = by_opacity + regular, by_scale + regular / 3
    return rows, {
        "means_m": slopes["means_m"],
        "quats_wxyz": slopes["quats_wxyz"],
        "log_scales": by_scale * scales,
        "logits": (by_opacity * opacities * (1.0 - opacities))[:, None],
        "sh": slopes["sh"].reshape(len(rows), -1),
    }


def _moved(rendered: Rendered, shape: tuple[int, ...]) -> Array:
    seen = rendered.visibility
    assert seen.absolute_gradient_px is not None and seen.weight is not None
    gradient = seen.absolute_gradient_px[seen.weight > 0].numpy()
    moved: Array = np.hypot(gradient[:, 0] * (0.5 * shape[2]), gradient[:, 1] * (0.5 * shape[1]))
    return moved


def quantised(planes: Array) -> npt.NDArray[np.uint8]:
    """Colours (3, H, W) in 0..1 as a picture (H, W, 3)."""
    return np.ascontiguousarray((np.clip(planes, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8).transpose(1, 2, 0))
