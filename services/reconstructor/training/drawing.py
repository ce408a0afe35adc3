"""One view of the Gaussians in training: the loss and its gradients, or the picture alone."""

import threading
from dataclasses import dataclass

import numpy as np
import torch

from readygo.common.arrays import Float32Array, Int64Array
from readygo.services.reconstructor.differentiable.autograd import Rendered, rasterize
from readygo.services.reconstructor.training.config import GaussiansConfig
from readygo.services.reconstructor.training.density import REGULAR
from readygo.services.reconstructor.training.parameters import Gaussians
from readygo.services.reconstructor.training.photometric import SSIM_WEIGHT, Photometric
from readygo.services.reconstructor.training.photos import Photo
from readygo.services.reconstructor.training.plane_kernels import add_feature_slopes, write_features
from readygo.services.reconstructor.training.surface_slopes import PlaneView, surface_slopes

Leaves = dict[str, torch.Tensor]
Gradients = dict[str, Float32Array]
OBSERVED_PX = 0.1
"""A view shows a Gaussian that covers so much of a whole image [px]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Geometry:
    """What a view's surfaces are compared with."""

    neighbour: Photo | None
    """The neighbour's photo; None if there is none: only normals within the view count."""
    rng: np.random.Generator
    """Chooses patches."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ViewGradients:
    """Loss and gradients of one view."""

    loss: float
    rows: Int64Array
    """The Gaussians with weight in the image or in its neighbour's, ascending, shape (n,)."""
    gradients: dict[str, Float32Array]
    """Rows of the parameters' gradients, shape (n, K)."""
    moved_rows: Int64Array
    """The Gaussians with weight in the view itself, ascending, shape (m,)."""
    moved: Float32Array
    """Gradients of the projected means of these, for an image of 2x2 units, shape (m,)."""
    exposure: Float32Array
    """Gradients by the logarithms of the image's gains and by its offsets, shape (2, 3)."""


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
    """What the rasterizer is given; means, quaternions and colours share the memory of the parameters."""
    arrays = {
        "means_m": gaussians.values["means_m"],
        "quats_wxyz": gaussians.values["quats_wxyz"],
        "scales_m": gaussians.scales_m,
        "opacities": gaussians.opacities,
        "sh": gaussians.values["sh"].reshape(len(gaussians), -1, 3),
    }
    return {name: torch.from_numpy(array) for name, array in arrays.items()}


def draw(leaves: Leaves, photo: Photo, sh_degree: int, *, gradients: bool = False, absolute: bool = False) -> Rendered:
    """Draw the view of a photo; `absolute` gradients of the projected means take a tenth of the time."""
    return rasterize(
        **leaves,
        T_world_camera=torch.from_numpy(photo.T_world_camera),
        K_px=photo.K_px,
        height_px=photo.rgb.shape[1],
        width_px=photo.rgb.shape[2],
        sh_degree=sh_degree,
        sparse_gradients=gradients,
        absolute_gradients=absolute,
    )


def planes_of(rendered: Rendered) -> Float32Array:
    """The colours of an image, shape (3, H, W)."""
    assert rendered.rgb is not None
    planes: Float32Array = rendered.rgb.detach().permute(2, 0, 1).contiguous().numpy()
    return planes


def view_gradients(
    leaves: Leaves,
    photo: Photo,
    exposure: Float32Array,
    sh_degree: int,
    settings: GaussiansConfig,
    geometry: Geometry | None = None,
) -> ViewGradients:
    """Loss and gradients of one view, and of the neighbour that it is compared with.

    Args:
        leaves: See `leaves_of`.
        photo: What the view looks like.
        exposure: Logarithms of the image's gains, and offsets, shape (2, 3).
        sh_degree: Higher degrees are left out.
        settings: Weights of the losses.
        geometry: What normals and depths are compared with, if they are.
    """
    leaves = {name: leaf.detach().requires_grad_() for name, leaf in leaves.items()}
    if geometry is not None:
        leaves["features"] = _planes(leaves, photo)
    absolute = settings.density.needs_absolute
    rendered = draw(leaves, photo, sh_degree, gradients=True, absolute=absolute)
    planes = planes_of(rendered)
    gains, offsets = np.exp(exposure[0])[:, None, None], exposure[1][:, None, None]
    shown = planes * gains + offsets
    wanted = photo.rgb if photo.mask is None else np.where(photo.mask, photo.rgb, shown)
    loss, _, slope = _LOSSES.of(planes.shape[1:])(shown, wanted, SSIM_WEIGHT)
    if photo.mask is not None:
        # What is ignored shows what is drawn there: it has no error, nor part in how others should change.
        slope *= photo.mask
    # What is not finite is found by the loss, and named there.
    with np.errstate(over="ignore", invalid="ignore"):
        by_exposure = np.stack([(slope * planes * gains).sum(axis=(1, 2)), slope.sum(axis=(1, 2))])
    assert rendered.rgb is not None
    images, slopes = [rendered.rgb], [torch.from_numpy(slope * gains).permute(1, 2, 0)]
    other_leaves: Leaves | None = None
    if geometry is not None:
        assert rendered.features is not None
        shape_loss, by_planes, other_leaves = _shape_loss(leaves, rendered, photo, geometry, settings)
        images, slopes = [*images, rendered.features], [*slopes, torch.from_numpy(by_planes).permute(1, 2, 0)]
        loss += shape_loss
    torch.autograd.backward(images, slopes)  # type: ignore[no-untyped-call]
    rows, gradients = _parameter_gradients(leaves, photo, settings)
    if other_leaves is not None and geometry is not None and geometry.neighbour is not None:
        other = _parameter_gradients(other_leaves, geometry.neighbour, settings)
        moved_rows, (rows, gradients) = rows, _merge((rows, gradients), other)
    else:
        moved_rows = rows
    return ViewGradients(
        loss=loss,
        rows=rows,
        gradients=gradients,
        moved_rows=moved_rows,
        moved=_move(rendered, planes.shape, absolute),
        exposure=by_exposure,
    )


def observe(leaves: Leaves, photo: Photo, pixels_min: float = OBSERVED_PX) -> Int64Array:
    """The Gaussians that cover more than so many pixels of a photo."""
    leaves = {name: leaf.detach().requires_grad_() for name, leaf in leaves.items() if name != "sh"}
    return draw(leaves, photo, 0, gradients=True).rows_shown(pixels_min)


def _planes(leaves: Leaves, photo: Photo) -> torch.Tensor:
    means, quats, scales = (leaves[name].detach().numpy() for name in ("means_m", "quats_wxyz", "scales_m"))
    features = np.empty((len(means), 4), dtype=np.float32)
    write_features(means, quats, scales, photo.T_world_camera[:3, 3].copy(), features)
    return torch.from_numpy(features).requires_grad_()


def _shape_loss(
    leaves: Leaves, rendered: Rendered, photo: Photo, geometry: Geometry, settings: GaussiansConfig
) -> tuple[float, Float32Array, Leaves | None]:
    """The loss of surfaces, its derivatives by the view's planes, and the leaves of its neighbour with theirs."""
    one, alpha = _plane_view(rendered, photo), rendered.alpha.detach().numpy()
    neighbour = geometry.neighbour
    if neighbour is None:
        loss, by_planes, _ = surface_slopes(one, None, alpha, settings.geometry, geometry.rng)
        return loss, by_planes, None
    other_leaves = {name: leaf.detach().requires_grad_() for name, leaf in leaves.items() if name != "sh"}
    other_leaves["features"] = _planes(other_leaves, neighbour)
    drawn = draw(other_leaves, neighbour, 0, gradients=True)
    other = _plane_view(drawn, neighbour)
    loss, by_planes, by_others = surface_slopes(one, other, alpha, settings.geometry, geometry.rng)
    assert drawn.features is not None
    assert by_others is not None
    drawn.features.backward(torch.from_numpy(by_others).permute(1, 2, 0))  # type: ignore[no-untyped-call]
    return loss, by_planes, other_leaves


def _plane_view(rendered: Rendered, photo: Photo) -> PlaneView:
    assert rendered.features is not None
    planes: Float32Array = rendered.features.detach().permute(2, 0, 1).contiguous().numpy()
    return PlaneView(photo=photo, planes=planes)


def _parameter_gradients(leaves: Leaves, photo: Photo, settings: GaussiansConfig) -> tuple[Int64Array, Gradients]:
    """Gradients by what is stored: logarithms of scales, logits of opacities."""
    sparse = {name: leaf.grad for name, leaf in leaves.items() if leaf.grad is not None}
    if not sparse:
        return np.empty(0, dtype=np.int64), {}
    rows = sparse["means_m"]._indices()[0].numpy()
    slopes = {name: gradient._values().numpy() for name, gradient in sparse.items()}
    if "features" in slopes:
        _add_plane_gradients(slopes, leaves, rows, photo)
    scales, opacities = leaves["scales_m"].detach().numpy()[rows], leaves["opacities"].detach().numpy()[rows]
    if "sh" in slopes:
        _add_regular(slopes, scales, len(leaves["opacities"]), settings)
    gradients = {
        "means_m": slopes["means_m"],
        "quats_wxyz": slopes["quats_wxyz"],
        "log_scales": slopes["scales_m"] * scales,
        "logits": (slopes["opacities"] * opacities * (1.0 - opacities))[:, None],
    }
    if "sh" in slopes:
        gradients["sh"] = slopes["sh"].reshape(len(rows), 3 * slopes["sh"].shape[1])
    return rows, gradients


def _add_plane_gradients(slopes: Gradients, leaves: Leaves, rows: Int64Array, photo: Photo) -> None:
    """What normals and distances of planes want of means and quaternions."""
    means, quats, scales = (leaves[name].detach().numpy() for name in ("means_m", "quats_wxyz", "scales_m"))
    camera_m = photo.T_world_camera[:3, 3].copy()
    by_features, by_means, by_quats = (slopes[name] for name in ("features", "means_m", "quats_wxyz"))
    add_feature_slopes(means, quats, scales, camera_m, rows, by_features, by_means, by_quats)


def _add_regular(slopes: Gradients, scales: Float32Array, count: int, settings: GaussiansConfig) -> None:
    """Losses of the Gaussians alone: faint and small ones for MCMC, flat ones for surfaces."""
    if settings.density.method == "mcmc":
        regular = np.float32(REGULAR / count)
        slopes["opacities"], slopes["scales_m"] = slopes["opacities"] + regular, slopes["scales_m"] + regular / 3
    if settings.geometry.enabled and len(scales):
        flat = slopes["scales_m"].copy()
        flat[np.arange(len(scales)), scales.argmin(axis=1)] += np.float32(settings.geometry.flatten / len(scales))
        slopes["scales_m"] = flat


def _merge(one: tuple[Int64Array, Gradients], other: tuple[Int64Array, Gradients]) -> tuple[Int64Array, Gradients]:
    """Sums of rows of two views of the same Gaussians."""
    place = np.zeros(max(part.max(initial=-1) for part in (one[0], other[0])) + 1, dtype=np.int64)
    place[one[0]], place[other[0]] = 1, 1
    rows = np.flatnonzero(place)
    place[rows] = np.arange(len(rows))
    total = {}
    for name, values in one[1].items():
        total[name] = np.zeros((len(rows), values.shape[1]), dtype=np.float32)
        total[name][place[one[0]]] = values
        if name in other[1]:
            total[name][place[other[0]]] += other[1][name]
    return rows, total


def _move(rendered: Rendered, shape: tuple[int, ...], absolute: bool) -> Float32Array:
    seen = rendered.visibility
    gradients = seen.absolute_gradient_px if absolute else seen.gradient_px
    assert gradients is not None
    assert seen.weight is not None
    gradient = gradients[seen.weight > 0].numpy()
    moved: Float32Array = np.hypot(gradient[:, 0] * (0.5 * shape[2]), gradient[:, 1] * (0.5 * shape[1]))
    return moved
