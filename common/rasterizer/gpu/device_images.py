"""Images of a batch while they are on the device."""

from dataclasses import dataclass

import torch
from torch import Tensor

from readygo.common.images.images import FIELDS, Images


@dataclass(frozen=True, kw_only=True, eq=False)
class DeviceImages:
    """Images of B cameras; see `readygo.common.images.images.Images` for what they show."""

    rgb: Tensor
    """Colours before rounding, not clipped above 1, shape (B, H, W, 3)."""
    alpha: Tensor
    """One minus the transmittance that is left, shape (B, H, W)."""
    depth_m: Tensor | None = None
    """Mean depth along the optical axis, weighted as colours are [m]; inf where nothing is drawn, shape (B, H, W)."""
    median_depth_m: Tensor | None = None
    """Depth of the Gaussian that brings the transmittance below one half [m]; inf: none, shape (B, H, W)."""
    mask: Tensor | None = None
    """Human that this median Gaussian belongs to, counted from 1; 0: scene or none; uint8, shape (B, H, W)."""
    normal: Tensor | None = None
    """Mean normals in the camera's frame, of length 1; 0 where nothing is drawn, shape (B, H, W, 3)."""


def rgb_bytes(rgb: Tensor) -> Tensor:
    """Colours as bytes, rounded and clipped."""
    return (rgb * 255.0 + 0.5).clamp(0.0, 255.0).to(torch.uint8)


def mean_depth(weighted_m: Tensor, alpha: Tensor) -> Tensor:
    """Depth sums over weights; inf where nothing is drawn."""
    drawn = alpha > 0
    return torch.where(drawn, weighted_m / torch.where(drawn, alpha, torch.ones_like(alpha)), torch.inf)


def unit_normals(sums: Tensor) -> Tensor:
    """Sums of normals (..., 3) at length 1; 0 where nothing is drawn."""
    length = sums.norm(dim=-1, keepdim=True)
    return torch.where(length > 0, sums / torch.where(length > 0, length, torch.ones_like(length)), 0.0)


def host_images(images: DeviceImages, wanted: frozenset[str]) -> Images:
    """The wanted images, rgb among them, copied from the device."""
    others = {FIELDS[name]: getattr(images, FIELDS[name]) for name in wanted - {"rgb"}}
    arrays = {field: tensor.cpu().numpy() for field, tensor in others.items() if tensor is not None}
    return Images(rgb=rgb_bytes(images.rgb).cpu().numpy(), **arrays)
