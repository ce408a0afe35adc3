"""Our own kernels behind the interface of `GpuRasterizer`."""

from collections.abc import Callable, Sequence

import torch
from torch import Tensor

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar
from readygo.common.gaussians import GaussianCloud
from readygo.common.rasterizer.gpu.batch import ViewBatch
from readygo.common.rasterizer.gpu.device_clouds import upload
from readygo.common.rasterizer.gpu.device_images import DeviceImages, mean_depth, unit_normals
from readygo.common.rasterizer.gpu.triton.blend import COLOUR_PLANES, DEPTH_PLANES
from readygo.common.rasterizer.gpu.triton.pipeline import TritonPipeline
from readygo.common.rasterizer.gpu.triton.settings import TritonSettings


class TritonKernels:
    """Draws batches with the Triton kernels.

    Args:
        scenes: Static clouds.
        avatars: Who may be drawn.
        K_px: Intrinsics [px] without skew, shape (3, 3).
        height_px: Image height.
        width_px: Image width.
        device: CUDA device, or the CPU under Triton's interpreter.
        settings: Choices that change speed, not images.
    """

    def __init__(
        self,
        scenes: Sequence[GaussianCloud],
        avatars: Sequence[Avatar],
        K_px: Float64Array,
        height_px: int,
        width_px: int,
        device: torch.device,
        settings: TritonSettings,
    ) -> None:
        clouds = upload(scenes, avatars, device)
        self._pipeline = TritonPipeline(clouds, K_px, height_px, width_px, settings, device)

    def draw(self, batch: ViewBatch, wanted: frozenset[str]) -> DeviceImages:
        """Draw all cameras of a batch.

        Args:
            batch: Cameras and humans.
            wanted: Names out of `readygo.common.images.images.OUTPUTS`.

        Returns:
            The wanted images.
        """
        depth, normals = bool(wanted & {"depth", "median_depth", "mask"}), "normal" in wanted
        planes = self._pipeline.draw(batch, depth=depth, normals=normals)
        return _images(planes, depth, normals)

    def set_clock(self, clock: Callable[[str], None]) -> None:
        """Have the names of the stages called out as they begin."""
        self._pipeline.clock = clock


def _images(planes: Tensor, depth: bool, normals: bool) -> DeviceImages:
    """Images of the planes that `blend` leaves."""
    alpha = 1.0 - planes[:, COLOUR_PLANES - 1]
    first = COLOUR_PLANES + depth * DEPTH_PLANES
    return DeviceImages(
        rgb=planes[:, :3].permute(0, 2, 3, 1),
        alpha=alpha,
        depth_m=mean_depth(planes[:, COLOUR_PLANES], alpha) if depth else None,
        median_depth_m=planes[:, COLOUR_PLANES + 1] if depth else None,
        mask=planes[:, COLOUR_PLANES + 2].to(torch.uint8) if depth else None,
        normal=unit_normals(planes[:, first : first + 3].permute(0, 2, 3, 1)) if normals else None,
    )
