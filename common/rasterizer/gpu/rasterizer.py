"""The GPU rasterizer: many cameras over one scene, each with its own posed humans, in one call."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext
from typing import Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

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
PIXELS_AT_ONCE = 1 << 24
"""Pixels that are drawn together: each takes some 100 bytes on the device until its image is on the host."""


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
        ValueError: If `kernels` is unknown.
        ReadygoError: If a package, a GPU or a compiler is missing, or the image is too large for the kernels.
    """

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
        self._views_max = max(1, PIXELS_AT_ONCE // (height_px * width_px))
        wearers, camera = list(avatars.values()), (np.asarray(K_px, dtype=np.float64), height_px, width_px)
        self._kernels: _Kernels
        with self._as_current_device():
            if kernels == "gsplat":
                from readygo.common.rasterizer.gpu.gsplat_kernels import GsplatKernels

                self._kernels = GsplatKernels(clouds, wearers, *camera, self._device)
            else:
                from readygo.common.rasterizer.gpu.triton.kernels import TritonKernels

                self._kernels = TritonKernels(clouds, wearers, *camera, self._device, settings or TritonSettings())

    @property
    def views_at_once(self) -> int:
        """How many views it likes to be given together: fewer of larger images."""
        return min(VIEWS_AT_ONCE, self._views_max)

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        """The images of views; see `Rasterizer.render`.

        Raises:
            ReadygoError: As `Rasterizer.render`, or if a view has shadows or intrinsics, or its humans a lead.
        """
        wanted = checked_outputs(views, outputs, self._numbers)
        images = empty_images(len(views), *self._size_px, wanted)
        first = 0
        for drawn in self._draw(views, wanted):
            for name, part in host_images(drawn, wanted).arrays().items():
                getattr(images, name)[first : first + len(part)] = part
            first += len(drawn.rgb)
        return images

    def render_on_device(self, views: Sequence[View]) -> Tensor:
        """The colours of views as a tensor that stays on the device, uint8, shape (V, H, W, 3)."""
        checked_outputs(views, (), self._numbers)
        rgb = torch.empty((len(views), *self._size_px, 3), dtype=torch.uint8, device=self._device)
        first = 0
        for drawn in self._draw(views):
            rgb[first : first + len(drawn.rgb)] = rgb_bytes(drawn.rgb)
            first += len(drawn.rgb)
        return rgb

    def set_clock(self, clock: Callable[[str], None]) -> None:
        """Have the names of the stages called out as their work is queued, for benchmarks; gsplat has none."""
        if hasattr(self._kernels, "set_clock"):
            self._kernels.set_clock(clock)

    def _draw(self, views: Sequence[View], wanted: frozenset[str] = frozenset()) -> Iterator[DeviceImages]:
        """The images of views, in parts that the device's memory holds."""
        if any(view.shadows is not None for view in views):
            raise ReadygoError("The GPU backends draw no shadows; use the cpu backend.")
        if any(view.K_px is not None for view in views):
            raise ReadygoError("The GPU backends draw one field of view; use the cpu backend.")
        if any(human.lead_m for view in views for human in view.humans):
            raise ReadygoError("The GPU backends draw feet as their depths say; use the cpu backend.")
        for first in range(0, len(views), self._views_max):
            with self._as_current_device(), torch.no_grad():
                batch = make_batch(views[first : first + self._views_max], self._numbers, self._device)
                drawn = self._kernels.draw(batch, wanted)
            yield drawn

    def _as_current_device(self) -> AbstractContextManager[object]:
        """Make the device the current one: Triton launches there, not where its tensors are."""
        return torch.cuda.device(self._device) if self._device.type == "cuda" else nullcontext()
