"""The GPU rasterizer: many cameras over one scene, each with its own posed humans, in one call."""

from collections.abc import Callable, Mapping, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from readygo.common.arrays import Float32Array
from readygo.common.avatars import Avatar
from readygo.common.errors import ReadygoError
from readygo.common.gaussians import GaussianCloud
from readygo.common.images.images import Images, empty_images
from readygo.common.rasterizer.gpu.availability import require_kernels
from readygo.common.rasterizer.gpu.batch import ViewBatch, make_batch
from readygo.common.rasterizer.gpu.device_images import DeviceImages, host_images, rgb_bytes
from readygo.common.rasterizer.gpu.triton.settings import TritonSettings
from readygo.common.rasterizer.interface import View, checked_outputs

VIEWS_AT_ONCE = 64
"""A batch that keeps a GPU busy: on an H100 one of 256 views is a sixth faster per view."""


class _Kernels(Protocol):
    def draw(self, batch: ViewBatch, wanted: frozenset[str]) -> DeviceImages: ...


class GpuRasterizer:
    """Draws views of one scene with one camera, many in one go; see `readygo.common.rasterizer.interface`.

    It takes `GaussianCloud`s, not the packed scenes of the CPU: it sorts and packs them for the device itself, which
    takes about a second per million Gaussians.

    Args:
        scenes: Static clouds, such as a scene and its sky.
        avatars: Who may be drawn, by name.
        K_px: Intrinsics [px] without skew, shape (3, 3).
        height_px: Image height.
        width_px: Image width.
        kernels: "triton", our own, or "gsplat".
        device: CUDA device; "cpu" only for tests, under Triton's interpreter.
        settings: Choices of the Triton kernels that change speed, not images.

    Raises:
        ValueError: If `kernels` is unknown, or the image has too many tiles.
        ReadygoError: If a package, a GPU or a compiler is missing.
    """

    views_at_once = VIEWS_AT_ONCE

    def __init__(
        self,
        scenes: GaussianCloud | Sequence[GaussianCloud],
        avatars: Mapping[str, Avatar],
        K_px: npt.ArrayLike,
        height_px: int,
        width_px: int,
        *,
        kernels: str = "triton",
        device: str = "cuda",
        settings: TritonSettings | None = None,
    ) -> None:
        require_kernels(kernels, device)
        clouds = [scenes] if isinstance(scenes, GaussianCloud) else list(scenes)
        self._device, self._numbers = torch.device(device), {name: number for number, name in enumerate(avatars)}
        self._size_px = height_px, width_px
        wearers, camera = list(avatars.values()), (np.asarray(K_px, dtype=np.float64), height_px, width_px)
        self._kernels: _Kernels
        if kernels == "gsplat":
            from readygo.common.rasterizer.gpu.gsplat_kernels import GsplatKernels

            self._kernels = GsplatKernels(clouds, wearers, *camera, self._device)
        else:
            from readygo.common.rasterizer.gpu.triton.kernels import TritonKernels

            self._kernels = TritonKernels(clouds, wearers, *camera, self._device, settings or TritonSettings())

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        """The images of views; see `Rasterizer.render`.

        Raises:
            ReadygoError: As `Rasterizer.render`, or if a view has shadows or intrinsics, or its humans a lead.
        """
        wanted = checked_outputs(views, outputs, self._numbers)
        if not views:
            return empty_images(0, *self._size_px, wanted)
        return host_images(self._draw(views, wanted), wanted)

    def render_float(self, view: View) -> Float32Array:
        """The colours of a view before rounding, not clipped above 1, shape (H, W, 3)."""
        checked_outputs([view], (), self._numbers)
        rgb: Float32Array = self._draw([view]).rgb[0].cpu().numpy()
        return rgb

    def render_on_device(self, views: Sequence[View]) -> Tensor:
        """The colours of views as a tensor that stays on the device, uint8, shape (V, H, W, 3)."""
        checked_outputs(views, (), self._numbers)
        return rgb_bytes(self._draw(views).rgb)

    def set_clock(self, clock: Callable[[str], None]) -> None:
        """Have the names of the stages called out as their work is queued, for benchmarks; gsplat has none."""
        if hasattr(self._kernels, "set_clock"):
            self._kernels.set_clock(clock)

    def _draw(self, views: Sequence[View], wanted: frozenset[str] = frozenset()) -> DeviceImages:
        if any(view.shadows is not None for view in views):
            raise ReadygoError("The GPU backends draw no shadows; use the cpu backend.")
        if any(view.K_px is not None for view in views):
            raise ReadygoError("The GPU backends draw one field of view; use the cpu backend.")
        if any(human.lead_m for view in views for human in view.humans):
            raise ReadygoError("The GPU backends draw feet as their depths say; use the cpu backend.")
        batch = make_batch(views, self._numbers, self._device)
        with torch.no_grad():
            return self._kernels.draw(batch, wanted)
