"""gsplat's kernels behind the interface of `GpuRasterizer`; this and `gsplat_values` alone know gsplat.

What differs from `readygo.common.rasterizer.constants`, and what is done about it:

- alpha cap 0.999: opacities are capped at 0.99 instead, so that no alpha exceeds 0.99.
- The Gaussian that would bring a pixel's transmittance to 1e-4 or below is dropped together with what follows. With
  alphas of at most 0.99 a pixel then lacks up to 1 % of its light (README.md has the measured consequence).
- Footprints end at min(3.33, sqrt(2 ln(255 opacity))) sigmas, which is the same box for every opacity up to 1.
- One call draws one set of Gaussians: cameras that see other humans or other poses need separate calls.

Source: gsplat 1.5.3, `gsplat/rendering.py` and `gsplat/cuda/csrc/RasterizeToPixels3DGSFwd.cu`.
"""

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from readygo.common.arrays import Float64Array, FloatingArray
from readygo.common.avatars import Avatar
from readygo.common.avatars.torch_posing import joint_transforms, load_skeletons, load_skin, pose_gaussians
from readygo.common.errors import ReadygoError, first_line
from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.rasterizer.backend_names import GSPLAT_OUTPUTS
from readygo.common.rasterizer.constants import ALPHA_MAX, DILATION_PX2, NEAR_M
from readygo.common.rasterizer.gpu.batch import ViewBatch
from readygo.common.rasterizer.gpu.chunks import morton_order
from readygo.common.rasterizer.gpu.device_images import DeviceImages, mean_depth, unit_normals
from readygo.common.rasterizer.gpu.light import gains
from readygo.common.rasterizer.packed.avatar import avatar_normals

FAR_M = 1e10
"""gsplat wants a far plane; skies are at 1.8 km."""
TILE_PX = 16
"""The only size that gsplat is tested with."""

Rasterization = Callable[..., tuple[Tensor, Tensor, dict[str, Any]]]


@dataclass(frozen=True, kw_only=True, eq=False)
class _Gaussians:
    """N Gaussians as gsplat takes them, in the world shifted to the scene's middle, float32."""

    means: Tensor
    quats: Tensor
    scales: Tensor
    opacities: Tensor
    sh: Tensor


class GsplatKernels:
    """Draws batches with gsplat.

    Args:
        scenes: Static clouds.
        avatars: Who may be drawn.
        K_px: Intrinsics [px] without skew, shape (3, 3).
        height_px: Image height.
        width_px: Image width.
        device: CUDA device.
        rasterization: Stands in for `gsplat.rasterization`.
    """

    def __init__(
        self,
        scenes: Sequence[GaussianCloud],
        avatars: Sequence[Avatar],
        K_px: Float64Array,
        height_px: int,
        width_px: int,
        device: torch.device,
        rasterization: Rasterization | None = None,
    ) -> None:
        self._rasterization = rasterization or gsplat_rasterization()
        self._K = torch.tensor(K_px, dtype=torch.float32, device=device)
        self._height, self._width, self._device = height_px, width_px, device
        clouds = [*scenes, *(avatar.cloud for avatar in avatars)]
        self._degree = max((cloud.sh_degree for cloud in clouds), default=0)
        # gsplat computes in float32: coordinates count from the middle of the first scene.
        middle = np.median(scenes[0].means_m, axis=0) if scenes and len(scenes[0]) else np.zeros(3)
        self._origin_m = torch.tensor(middle.astype(np.float64), device=device)
        self._scene = _join_gaussians([self._load_cloud(scene, middle) for scene in scenes]) if scenes else None
        self._skeletons = load_skeletons(avatars, device)
        self._wearers = [
            (load_skin(avatar, device), self._load_cloud(avatar.cloud, None), self._own_normals(avatar))
            for avatar in avatars
        ]

    def _load_cloud(self, cloud: GaussianCloud, middle: FloatingArray | None) -> _Gaussians:
        """A cloud on the device: relative to `middle` and in Morton order, or as it is."""
        means = cloud.means_m.astype(np.float64)
        if middle is not None:
            order = morton_order(cloud)
            cloud, means = cloud.select(order), means[order] - middle
        sh = np.zeros((len(cloud), (self._degree + 1) ** 2, 3), dtype=np.float32)
        sh[:, : cloud.sh.shape[1]] = cloud.sh

        def on_device(array: FloatingArray) -> Tensor:
            return torch.tensor(array, dtype=torch.float32, device=self._device)

        return _Gaussians(
            means=on_device(means),
            quats=on_device(cloud.quats_wxyz),
            scales=on_device(cloud.scales_m),
            opacities=on_device(np.minimum(cloud.opacities, np.float32(ALPHA_MAX))),
            sh=on_device(sh),
        )

    def _own_normals(self, avatar: Avatar) -> Tensor:
        """Normals that light falls on, along the principal axes of each Gaussian, shape (N, 3)."""
        R = matrix_from_quat(avatar.cloud.quats_wxyz.astype(np.float64))
        own = np.einsum("nik,ni->nk", R, avatar_normals(avatar))
        return torch.tensor(own, dtype=torch.float32, device=self._device)

    def draw(self, batch: ViewBatch, wanted: frozenset[str]) -> DeviceImages:
        """Draw all cameras of a batch.

        Args:
            batch: Cameras and humans.
            wanted: Names out of `GSPLAT_OUTPUTS`.

        Returns:
            The wanted images.

        Raises:
            ReadygoError: If a wanted image is none of `GSPLAT_OUTPUTS`.
        """
        if not wanted <= GSPLAT_OUTPUTS:
            lacking = ", ".join(sorted(wanted - GSPLAT_OUTPUTS))
            raise ReadygoError(
                f"gsplat kernels make {', '.join(sorted(GSPLAT_OUTPUTS))}, not {lacking}; use triton kernels."
            )
        parts = [self._draw_alike(batch.part(first, end), wanted) for first, end in _alike(batch)]
        names = [name for name in ("rgb", "alpha", "depth_m", "normal") if getattr(parts[0], name) is not None]
        return DeviceImages(**{name: torch.cat([getattr(part, name) for part in parts]) for name in names})

    def _draw_alike(self, batch: ViewBatch, wanted: frozenset[str]) -> DeviceImages:
        """Draw cameras that see the same humans in the same poses."""
        gaussians = _join_gaussians([*([self._scene] if self._scene else []), *self._pose_humans(batch)])
        T_camera_world = _inverse(batch.T_world_camera, self._origin_m)
        depth = "depth" in wanted
        colours, alpha = self._call(gaussians, gaussians.sh, T_camera_world, self._degree, depth)
        normal = None
        if "normal" in wanted:
            normal = unit_normals(self._call(gaussians, _normals(gaussians, T_camera_world), T_camera_world, None)[0])
        return DeviceImages(
            rgb=colours[..., :3],
            alpha=alpha,
            depth_m=mean_depth(colours[..., 3], alpha) if depth else None,
            normal=normal,
        )

    def _call(
        self, gaussians: _Gaussians, colours: Tensor, T_camera_world: Tensor, degree: int | None, depth: bool = False
    ) -> tuple[Tensor, Tensor]:
        """Sums of colours, and of depths as a fourth channel, (C, H, W, 3 or 4), and alpha (C, H, W)."""
        images, alpha, _ = self._rasterization(
            means=gaussians.means,
            quats=gaussians.quats,
            scales=gaussians.scales,
            opacities=gaussians.opacities,
            colors=colours,
            viewmats=T_camera_world,
            Ks=self._K.expand(len(T_camera_world), 3, 3).contiguous(),
            width=self._width,
            height=self._height,
            near_plane=NEAR_M,
            far_plane=FAR_M,
            eps2d=DILATION_PX2,
            sh_degree=degree,
            packed=True,
            tile_size=TILE_PX,
            render_mode="RGB+D" if depth else "RGB",
        )
        return images, alpha[..., 0]

    def _pose_humans(self, batch: ViewBatch) -> list[_Gaussians]:
        """The humans of the first camera, in their light."""
        numbers = batch.avatar[0].long()
        if not len(numbers):
            return []
        root = batch.root_m[0] - self._origin_m
        A = joint_transforms(self._skeletons, numbers.clamp(min=0), root, batch.pose_axis_angle[0]).float()
        humans = []
        for place, number in enumerate(numbers.tolist()):
            if number < 0:
                continue
            skin, own, normals = self._wearers[number]
            means, quats = pose_gaussians(skin, A[place : place + 1])
            gain = gains(batch.light[0, place], torch.einsum("nk,nkj->nj", normals, _axes(quats[0])))
            sh = gain[:, None] * own.sh
            # Colour is 0.5 and the harmonics: what the gain makes of the 0.5 goes to the first of them.
            sh[:, 0] += 0.5 * (gain - 1.0) / SH_C0
            humans.append(_Gaussians(means=means[0], quats=quats[0], scales=own.scales, opacities=own.opacities, sh=sh))
        return humans


def gsplat_rasterization() -> Rasterization:
    """The entry of gsplat, with its kernels compiled.

    Raises:
        ReadygoError: If they cannot be loaded.
    """
    try:
        from gsplat.cuda._backend import _C
        from gsplat.rendering import rasterization
    except Exception as error:
        raise ReadygoError(f"gsplat's kernels cannot be loaded: {first_line(error)}; use triton kernels.") from error
    if _C is None:
        raise ReadygoError("gsplat found no CUDA toolkit to compile its kernels with; use triton kernels.")
    return rasterization  # type: ignore[no-any-return]


def _join_gaussians(parts: Sequence[_Gaussians]) -> _Gaussians:
    if len(parts) == 1:
        return parts[0]
    names = ("means", "quats", "scales", "opacities", "sh")
    return _Gaussians(**{name: torch.cat([getattr(part, name) for part in parts]) for name in names})


def _alike(batch: ViewBatch) -> list[tuple[int, int]]:
    """Ranges of cameras that see the same humans in the same poses and light."""
    rows = torch.cat(
        [batch.avatar.double(), batch.root_m.flatten(1), batch.pose_axis_angle.flatten(1), batch.light.flatten(1)],
        dim=1,
    )
    changes = [0, *((rows[1:] != rows[:-1]).any(dim=1).nonzero()[:, 0] + 1).tolist(), len(rows)]
    return list(itertools.pairwise(changes))


def _inverse(T_world_camera: Tensor, origin_m: Tensor) -> Tensor:
    """The `viewmats` of gsplat: from the shifted world to the cameras, float32, shape (C, 4, 4)."""
    R_CW = T_world_camera[:, :3, :3].mT
    T = torch.zeros_like(T_world_camera)
    T[:, :3, :3] = R_CW
    T[:, :3, 3] = (R_CW @ (origin_m - T_world_camera[:, :3, 3])[..., None])[..., 0]
    T[:, 3, 3] = 1.0
    return T.float()


def _normals(gaussians: _Gaussians, T_camera_world: Tensor) -> Tensor:
    """Shortest axes that look towards each camera, in its frame, shape (C, N, 3)."""
    axes = _axes(gaussians.quats)
    axis = torch.take_along_dim(axes, gaussians.scales.argmin(dim=1)[:, None, None], dim=1)[:, 0]
    R = T_camera_world[:, :3, :3]
    normal = torch.einsum("cij,nj->cni", R, axis)
    mean = torch.einsum("cij,nj->cni", R, gaussians.means) + T_camera_world[:, None, :3, 3]
    return torch.where((normal * mean).sum(-1, keepdim=True) > 0, -normal, normal)


def _axes(quats_wxyz: Tensor) -> Tensor:
    """Principal axes, one per row, (N, 4) -> (N, 3, 3)."""
    w, x, y, z = (quats_wxyz / quats_wxyz.norm(dim=1, keepdim=True)).unbind(1)
    return torch.stack(
        [
            torch.stack([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)], dim=1),
            torch.stack([2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x)], dim=1),
            torch.stack([2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y)], dim=1),
        ],
        dim=1,
    )
