"""The GPU rasterizer: many cameras over one scene, each with its own posed people, in one call."""

from collections.abc import Callable, Sequence
from typing import Protocol

import numpy as np
import numpy.typing as npt
import torch
from torch import Tensor

from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud
from readygo.common.images.images import OUTPUTS, Images
from readygo.common.rasterizer.cpu.rasterizer import PosedPerson
from readygo.common.rasterizer.gpu.availability import require_kernels
from readygo.common.rasterizer.gpu.batch import Batch, make_batch
from readygo.common.rasterizer.gpu.device_images import DeviceImages, host_images, rgb_bytes
from readygo.common.rasterizer.gpu.triton.settings import TritonSettings

MAX_PEOPLE = 255
"""People that a mask of bytes can tell apart."""


class _Kernels(Protocol):
    def draw(self, batch: Batch, wanted: frozenset[str]) -> DeviceImages: ...


class GpuRasterizer:
    """Renders one scene with people in it, for cameras of one kind; not to be shared between threads.

    It takes `GaussianCloud`s, not the packed scenes of the CPU: it sorts and packs them for the device itself, which
    takes about a second per million Gaussians.

    Args:
        scenes: Static clouds, such as a scene and its sky.
        avatars: Who may be drawn.
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

    def __init__(
        self,
        scenes: GaussianCloud | Sequence[GaussianCloud],
        avatars: Sequence[Avatar],
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
        self._device, self._avatar_count = torch.device(device), len(avatars)
        lens = (np.asarray(K_px, dtype=np.float64), height_px, width_px, self._device)
        self._kernels: _Kernels
        if kernels == "gsplat":
            from readygo.common.rasterizer.gpu.gsplat_kernels import GsplatKernels

            self._kernels = GsplatKernels(clouds, avatars, *lens)
        else:
            from readygo.common.rasterizer.gpu.triton.kernels import TritonKernels

            self._kernels = TritonKernels(clouds, avatars, *lens, settings or TritonSettings())

    def render(self, T_world_camera: npt.ArrayLike, people: Sequence[PosedPerson] = ()) -> npt.NDArray[np.uint8]:
        """The image as bytes, sRGB for scenes trained on sRGB images.

        Args:
            T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
            people: People to draw.

        Returns:
            Shape (H, W, 3).

        Raises:
            ValueError: If the camera pose is not a finite 4x4 matrix, or a person is no valid one.
        """
        rgb: npt.NDArray[np.uint8] = self.render_batch(_one(T_world_camera), [people])[0]
        return rgb

    def render_float(
        self, T_world_camera: npt.ArrayLike, people: Sequence[PosedPerson] = ()
    ) -> npt.NDArray[np.float32]:
        """The image before rounding, not clipped above 1, shape (H, W, 3); see `render`."""
        rgb: npt.NDArray[np.float32] = self._draw(_one(T_world_camera), [people]).rgb[0].cpu().numpy()
        return rgb

    def render_batch(
        self, T_world_camera: npt.ArrayLike, people: Sequence[Sequence[PosedPerson]]
    ) -> npt.NDArray[np.uint8]:
        """Images of many cameras.

        Args:
            T_world_camera: Camera poses, OpenCV axes, shape (B, 4, 4).
            people: People that each camera sees, B sequences.

        Returns:
            Shape (B, H, W, 3).

        Raises:
            ValueError: If a pose is not a finite 4x4 matrix, the lengths differ, or a person is no valid one.
        """
        rgb: npt.NDArray[np.uint8] = self.render_batch_on_device(T_world_camera, people).cpu().numpy()
        return rgb

    def render_batch_on_device(self, T_world_camera: npt.ArrayLike, people: Sequence[Sequence[PosedPerson]]) -> Tensor:
        """The images of `render_batch` as a tensor that stays on the device."""
        return rgb_bytes(self._draw(T_world_camera, people).rgb)

    def render_images(
        self, T_world_camera: npt.ArrayLike, people: Sequence[PosedPerson] = (), outputs: Sequence[str] = ("rgb",)
    ) -> Images:
        """The image and others from the same pass.

        Args:
            T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
            people: People to draw; the mask numbers them from 1 in this order.
            outputs: Names out of `readygo.common.images.images.OUTPUTS`; "rgb" is always made.

        Returns:
            The images.

        Raises:
            ValueError: If the camera pose is not a finite 4x4 matrix, a name is unknown, or a mask of more than 255
                people is wanted.
            ReadygoError: If the kernels do not make one of these images.
        """
        wanted = frozenset(outputs)
        if not wanted <= set(OUTPUTS):
            raise ValueError(f"outputs must be names out of {', '.join(OUTPUTS)}; got {outputs!r}.")
        if "mask" in wanted and len(people) > MAX_PEOPLE:
            raise ValueError(f"a mask can tell {MAX_PEOPLE} people apart, got {len(people)}.")
        return host_images(self._draw(_one(T_world_camera), [people], wanted), wanted)

    def set_clock(self, clock: Callable[[str], None]) -> None:
        """Have the names of the stages called out as their work is queued, for benchmarks; gsplat has none."""
        if hasattr(self._kernels, "set_clock"):
            self._kernels.set_clock(clock)

    def _draw(
        self,
        T_world_camera: npt.ArrayLike,
        people: Sequence[Sequence[PosedPerson]],
        wanted: frozenset[str] = frozenset(),
    ) -> DeviceImages:
        batch = make_batch(T_world_camera, people, self._avatar_count, self._device)
        with torch.no_grad():
            return self._kernels.draw(batch, wanted)


def _one(T_world_camera: npt.ArrayLike) -> npt.NDArray[np.float64]:
    """One camera as a batch."""
    return np.asarray(T_world_camera, dtype=np.float64)[None]
