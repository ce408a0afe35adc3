"""The slow, obvious rasterizer that the fast ones are compared with: float64 NumPy, one Gaussian after the other."""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.avatars import Avatar, pose_avatar
from readygo.common.frames import matrix_from_quat
from readygo.common.gaussians import GaussianCloud, concatenate, rgb_along
from readygo.common.gaussians.irradiance import irradiance
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.images.images import Images, empty_images
from readygo.common.rasterizer.constants import (
    ALPHA_MAX,
    ALPHA_MIN,
    DILATION_PX2,
    FOV_MARGIN,
    LIGHT_MAX,
    LIGHT_MIN,
    NEAR_M,
    TRANSMITTANCE_MIN,
)
from readygo.common.rasterizer.interface import PinholeCamera, PosedHuman, View, checked_outputs, lead_terms
from readygo.common.rasterizer.packed.avatar import avatar_normals

_NOTHING = GaussianCloud(
    means_m=np.zeros((0, 3), np.float32),
    quats_wxyz=np.zeros((0, 4), np.float32),
    scales_m=np.zeros((0, 3), np.float32),
    opacities=np.zeros(0, np.float32),
    sh=np.zeros((0, 1, 3), np.float32),
)


@dataclass(frozen=True, kw_only=True, eq=False)
class ReferenceImages:
    """Images over a black background."""

    rgb: Float32Array
    """Colour as stored in the cloud (sRGB for trained scenes), not clipped above 1, shape (H, W, 3)."""
    alpha: Float32Array
    """One minus the transmittance that is left, shape (H, W)."""
    depth_m: Float32Array
    """Mean depth along the optical axis, weighted as colours are [m]; inf where nothing is drawn, shape (H, W)."""
    median_depth_m: Float32Array
    """Depth of the Gaussian that brings the transmittance below one half [m]; inf where there is none, shape (H, W)."""
    mask: UInt8Array
    """The instance of that Gaussian; 0 where there is none, shape (H, W)."""
    normal: Float32Array
    """Mean of the shortest axes that look towards the camera, weighted as colours are, of length 1, in the camera's
    frame; 0 where nothing is drawn, shape (H, W, 3)."""


@dataclass(frozen=True, kw_only=True, eq=False)
class _Splats:
    """Gaussians in the image, nearest first."""

    centre_px: Float64Array
    conic: Float64Array
    """Inverse covariance: xx, xy, yy, shape (N, 3)."""
    half_px: Float64Array
    """Half size of the box outside of which alpha is below the threshold, shape (N, 2)."""
    opacity: Float64Array
    rgb: Float64Array
    depth_m: Float64Array
    normal: Float64Array
    """Shortest axis, towards the camera, in its frame, shape (N, 3)."""
    instance: UInt8Array


class ReferenceRasterizer:
    """The reference as a rasterizer, seconds per image; see `readygo.common.rasterizer.interface`.

    Args:
        clouds: Static clouds, such as a scene and its sky.
        avatars: Who may be drawn, by name.
        camera: The camera.
    """

    views_at_once = 1

    def __init__(self, clouds: Sequence[GaussianCloud], avatars: Mapping[str, Avatar], camera: PinholeCamera) -> None:
        self._clouds, self._avatars, self._camera = list(clouds) or [_NOTHING], avatars, camera

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        """The images of views; see `Rasterizer.render`."""
        wanted = checked_outputs(views, outputs, self._avatars)
        images = empty_images(len(views), self._camera.height_px, self._camera.width_px, wanted)
        for number, view in enumerate(views):
            drawn = self._draw_view(view, None if wanted - {"rgb"} else view.shadows)
            for name, array in images.arrays().items():
                if name != "rgb":
                    array[number] = getattr(drawn, name)
            if view.shadows is not None and wanted - {"rgb"}:
                drawn = self._draw_view(view, view.shadows)
            images.rgb[number] = (np.clip(drawn.rgb, 0.0, 1.0) * 255.0 + 0.5).astype(np.uint8)
        return images

    def _draw_view(self, view: View, shadows: GaussianCloud | None) -> ReferenceImages:
        humans = [posed_and_lit(self._avatars[one.avatar], one) for one in view.humans]
        extra = [] if shadows is None else [shadows]
        clouds = [*self._clouds, *humans, *extra]
        numbers = [0] * len(self._clouds) + list(range(1, len(humans) + 1)) + [0] * len(extra)
        # The mask of more humans than bytes can tell apart is refused; their colours are not.
        instances = np.repeat(np.array(numbers).astype(np.uint8), [len(cloud) for cloud in clouds])
        leads = [np.zeros(len(cloud)) for cloud in clouds]
        for place, human in enumerate(view.humans, len(self._clouds)):
            leads[place] = _leads_m(clouds[place], human, view.T_world_camera)
        camera = self._camera
        return rasterize_reference(
            concatenate(clouds),
            view.T_world_camera,
            camera.K_px if view.K_px is None else view.K_px,
            camera.height_px,
            camera.width_px,
            instances=instances,
            leads_m=np.concatenate(leads),
        )


def _leads_m(posed: GaussianCloud, human: PosedHuman, T_world_camera: Float64Array) -> Float64Array:
    """By how much a human's Gaussians are sorted as nearer [m], shape (N,)."""
    R_CW, p_WC = T_world_camera[:3, :3].T, T_world_camera[:3, 3]
    a, b, c, d, most = lead_terms(human, R_CW, p_WC).astype(np.float64)
    leads: Float64Array = np.clip((posed.means_m - p_WC) @ R_CW.T @ np.array([a, b, c]) + d, 0.0, most)
    return leads


def posed_and_lit(avatar: Avatar, human: PosedHuman) -> GaussianCloud:
    """A human's Gaussians in the z-up world, in the light that falls on them."""
    posed = pose_avatar(avatar, human.root_m, human.pose_axis_angle)
    if human.light is None:
        return posed
    R_canonical, R_posed = matrix_from_quat(avatar.cloud.quats_wxyz), matrix_from_quat(posed.quats_wxyz)
    turned = np.einsum("nij,nkj,nk->ni", R_posed, R_canonical, avatar_normals(avatar))
    gain = np.sqrt(np.clip(irradiance(human.light, turned), LIGHT_MIN, LIGHT_MAX))[:, None]
    # Colour is 0.5 and the harmonics: what the gain makes of the 0.5 goes to the first of them.
    sh = gain * posed.sh
    sh[:, 0] += 0.5 * (gain[:, 0] - 1.0) / SH_C0
    return dataclasses.replace(posed, sh=sh.astype(np.float32))


def rasterize_reference(
    cloud: GaussianCloud,
    T_world_camera: npt.ArrayLike,
    K_px: npt.ArrayLike,
    height_px: int,
    width_px: int,
    *,
    instances: npt.ArrayLike | None = None,
    leads_m: npt.ArrayLike | None = None,
) -> ReferenceImages:
    """Draw Gaussians; the rules are in `readygo.common.rasterizer.constants`.

    Args:
        cloud: Gaussians in the world [m].
        T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
        K_px: Intrinsics [px] without skew, shape (3, 3).
        height_px: Image height.
        width_px: Image width.
        instances: What the mask shows of each Gaussian, 0 to 255, shape (N,); 0 by default.
        leads_m: By how much each Gaussian is sorted as nearer [m], shape (N,); 0 by default.

    Returns:
        The images.
    """
    K = np.asarray(K_px, dtype=np.float64)
    instance = np.zeros(len(cloud), dtype=np.uint8) if instances is None else np.asarray(instances, dtype=np.uint8)
    leads = np.zeros(len(cloud)) if leads_m is None else np.asarray(leads_m, dtype=np.float64)
    splats = _project(cloud, instance, leads, np.asarray(T_world_camera, dtype=np.float64), K, height_px, width_px)
    transmittance = np.ones((height_px, width_px))
    rgb = np.zeros((height_px, width_px, 3))
    depth, normal = np.zeros((height_px, width_px)), np.zeros((height_px, width_px, 3))
    median_depth, mask = np.full((height_px, width_px), np.inf), np.zeros((height_px, width_px), dtype=np.uint8)
    low = np.maximum(np.ceil(splats.centre_px - splats.half_px - 0.5), 0).astype(np.int64)
    limit = np.array([width_px, height_px]) - 1
    high = np.minimum(np.floor(splats.centre_px + splats.half_px - 0.5), limit).astype(np.int64)
    for n in np.flatnonzero((low <= high).all(axis=1)):
        box = np.s_[low[n, 1] : high[n, 1] + 1, low[n, 0] : high[n, 0] + 1]
        dx = np.arange(low[n, 0], high[n, 0] + 1) + 0.5 - splats.centre_px[n, 0]
        dy = (np.arange(low[n, 1], high[n, 1] + 1) + 0.5 - splats.centre_px[n, 1])[:, None]
        xx, xy, yy = splats.conic[n]
        alpha = np.minimum(ALPHA_MAX, splats.opacity[n] * np.exp(-0.5 * (xx * dx * dx + yy * dy * dy) - xy * dx * dy))
        alive = (alpha >= ALPHA_MIN) & (transmittance[box] >= TRANSMITTANCE_MIN)
        weight = np.where(alive, alpha, 0.0) * transmittance[box]
        rgb[box] += weight[..., None] * splats.rgb[n]
        depth[box] += weight * splats.depth_m[n]
        normal[box] += weight[..., None] * splats.normal[n]
        median = (transmittance[box] >= 0.5) & (transmittance[box] - weight < 0.5)
        median_depth[box][median], mask[box][median] = splats.depth_m[n], splats.instance[n]
        transmittance[box] -= weight
    alpha = 1.0 - transmittance
    mean_depth = np.divide(depth, alpha, out=np.full_like(depth, np.inf), where=alpha > 0)
    length = np.linalg.norm(normal, axis=2, keepdims=True)
    return ReferenceImages(
        rgb=rgb.astype(np.float32),
        alpha=alpha.astype(np.float32),
        depth_m=mean_depth.astype(np.float32),
        median_depth_m=median_depth.astype(np.float32),
        mask=mask,
        normal=np.divide(normal, length, out=np.zeros_like(normal), where=length > 0).astype(np.float32),
    )


def _project(
    cloud: GaussianCloud,
    instance: UInt8Array,
    leads_m: Float64Array,
    T_world_camera: Float64Array,
    K: Float64Array,
    height_px: int,
    width_px: int,
) -> _Splats:
    R_CW = T_world_camera[:3, :3].T
    p_WQ = cloud.means_m.astype(np.float64)
    p_CQ = (p_WQ - T_world_camera[:3, 3]) @ R_CW.T
    index = np.flatnonzero((p_CQ[:, 2] > NEAR_M) & (cloud.opacities >= ALPHA_MIN))
    index = index[np.argsort(p_CQ[index, 2] - leads_m[index], kind="stable")]
    p_CQ, p_WQ = p_CQ[index], p_WQ[index]
    x, y, z = p_CQ.T
    fx, fy, cx, cy = K[0, 0], K[1, 1], K[0, 2], K[1, 2]
    margin_x, margin_y = FOV_MARGIN * 0.5 * width_px / fx, FOV_MARGIN * 0.5 * height_px / fy
    u = np.clip(x / z, -cx / fx - margin_x, (width_px - cx) / fx + margin_x)
    v = np.clip(y / z, -cy / fy - margin_y, (height_px - cy) / fy + margin_y)
    zero = np.zeros_like(z)
    J = np.stack([np.stack([fx / z, zero, -fx * u / z], -1), np.stack([zero, fy / z, -fy * v / z], -1)], axis=-2)
    R_WQ = matrix_from_quat(cloud.quats_wxyz[index])
    L = J @ R_CW @ (R_WQ * cloud.scales_m[index].astype(np.float64)[:, None, :])
    S = L @ np.swapaxes(L, 1, 2) + DILATION_PX2 * np.eye(2)
    det = S[:, 0, 0] * S[:, 1, 1] - S[:, 0, 1] ** 2
    opacity = cloud.opacities[index].astype(np.float64)
    reach = 2 * np.log(opacity / ALPHA_MIN)
    return _Splats(
        centre_px=np.stack([fx * x / z + cx, fy * y / z + cy], axis=1),
        conic=np.stack([S[:, 1, 1] / det, -S[:, 0, 1] / det, S[:, 0, 0] / det], axis=1),
        half_px=np.sqrt(reach[:, None] * np.stack([S[:, 0, 0], S[:, 1, 1]], axis=1)),
        opacity=opacity,
        rgb=rgb_along(cloud.sh[index], p_WQ - T_world_camera[:3, 3]),
        depth_m=z,
        normal=_normals(p_CQ, R_CW @ R_WQ, cloud.scales_m[index]),
        instance=instance[index],
    )


def _normals(p_CQ: Float64Array, R_CQ: Float64Array, scales_m: Float32Array) -> Float64Array:
    """The shortest axis of each Gaussian, turned towards the camera."""
    axis = R_CQ[np.arange(len(p_CQ)), :, np.argmin(scales_m, axis=1)]
    return np.where((axis * p_CQ).sum(axis=1, keepdims=True) > 0, -axis, axis)
