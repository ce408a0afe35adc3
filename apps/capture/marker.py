"""A printed marker on a scene's floor, drawn into a rasterizer's image of the scene.

Every pixel of the pinhole image is the mean over a grid of rays through it, in linear light: edges are accurate to a
few hundredths of a pixel. The scene hides the sheet where its surface, by the median depth, rises above it. The median
depth is that of a Gaussian's centre, which lies in front of the floor along the ray by about the Gaussian's size.

Legend: S = the sheet's frame, origin at the marker's centre, x right and y up as printed, z out of the paper.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from readygo.common.gaussians import GaussianCloud
from readygo.common.images.images import FIELDS, Images
from readygo.common.images.light import LIGHT_ONE, byte_of_light, light_of_byte
from readygo.common.maps import FloorMap
from readygo.common.rasterizer.interface import PinholeCamera, Rasterizer, View
from readygo.services.reconstructor import PrintedSheet

PAPER, INK = 0.72, 0.03
"""Linear reflectance of white paper and of black ink, 0..1."""
THICKNESS_M = 0.003
"""The marker lies this far above the floor [m]."""
_HIDES_FROM_M, _HIDES_OVER_M = 0.05, 0.04
"""Height above the sheet at which the scene begins to hide it, and the additional height to full occlusion [m]:
reconstructed floors are centimetres thick."""
_AROUND_M = 1.5
_BESIDE_M, _REACH_SIGMAS, _REACH_SHARE = 0.5, 2.0, 0.95
"""The reach of the floor's Gaussians: largest distance of their centres from the marker's [m], their extent [standard
deviations], and the quantile of their sizes that counts."""
_SAMPLES = 4
"""Rays through a pixel along each axis."""
_NEAR_M = 0.05


@dataclass(frozen=True, kw_only=True, eq=False)
class FloorMarker:
    """A sheet with a marker, at a pose in the world."""

    sheet: PrintedSheet
    T_world_sheet: Float64Array
    """Pose of the marker's centre, shape (4, 4)."""
    reach_m: float = 0.0
    """Extent of the floor's Gaussians along the floor [m]."""

    @property
    def corners_m(self) -> Float64Array:
        """The black square's corners in the world: upper left, upper right, lower right, lower left; shape (4, 3)."""
        offset = self.sheet.corners_m - self._centre
        return offset @ self.T_world_sheet[:3, :2].T + self.T_world_sheet[:3, 3]

    @property
    def outline_m(self) -> Float64Array:
        """The paper's corners in the world, shape (4, 3)."""
        width, height = self.sheet.width_m, self.sheet.height_m
        corners = np.array([(0.0, height), (width, height), (width, 0.0), (0.0, 0.0)]) - self._centre
        outline: Float64Array = corners @ self.T_world_sheet[:3, :2].T + self.T_world_sheet[:3, 3]
        return outline

    @property
    def _centre(self) -> Float64Array:
        centre: Float64Array = self.sheet.corners_m.mean(axis=0)
        return centre

    def light_at(self, xy_m: Float64Array) -> tuple[Float64Array, BoolArray]:
        """Reflectance of the sheet at points of its frame, and True for those on it, shape (..., 2) -> (...), (...)."""
        x, y = np.moveaxis(xy_m + self._centre, -1, 0)
        inside = (x >= 0.0) & (x < self.sheet.width_m) & (y >= 0.0) & (y < self.sheet.height_m)
        columns, rows, black = _table(self.sheet)
        column = np.searchsorted(columns, x, side="right")
        row = np.searchsorted(rows, y, side="right")
        return np.where(black[row, column], INK, PAPER), inside


def _table(sheet: PrintedSheet) -> tuple[Float64Array, Float64Array, BoolArray]:
    """Edges of a sheet's black fields along x and y, and True for the fields between them that are black."""
    left, bottom, width, height = sheet.black_m.T
    columns, rows = np.unique([left, left + width]), np.unique([bottom, bottom + height])
    black = np.zeros((len(rows) + 1, len(columns) + 1), dtype=np.bool_)
    for x0, y0, x1, y1 in zip(left, bottom, left + width, bottom + height, strict=True):
        i, j = np.searchsorted(rows, [y0, y1]), np.searchsorted(columns, [x0, x1])
        black[i[0] + 1 : i[1] + 1, j[0] + 1 : j[1] + 1] = True
    return columns, rows, black


def lay_down(
    sheet: PrintedSheet,
    cloud: GaussianCloud,
    floor: FloorMap,
    ground_m: Float64Array,
    xy_m: tuple[float, float],
    yaw_rad: float,
) -> FloorMarker:
    """A sheet on the floor at a place, as level as the ground around.

    Args:
        sheet: The printed page.
        cloud: Gaussians of the scene.
        floor: Map of the local floor height.
        ground_m: Walkable places around [m], shape (N, 2): the floor's slope below the sheet alone is too noisy.
        xy_m: Position of the marker's centre [m].
        yaw_rad: Direction of the marker's x axis, from the world's x axis counterclockwise [rad].
    """
    near_m = ground_m[np.hypot(*(ground_m - xy_m).T) <= _AROUND_M]
    plane = np.column_stack([near_m - xy_m, np.ones(len(near_m))])
    (slope_x, slope_y, _), *_ = np.linalg.lstsq(plane, floor.at_many(near_m), rcond=None)
    height = floor.at(*xy_m)
    up = np.array([-slope_x, -slope_y, 1.0])
    up /= np.sqrt(up @ up)
    right = np.array([np.cos(yaw_rad), np.sin(yaw_rad), 0.0])
    right -= (right @ up) * up
    right /= np.sqrt(right @ right)
    T = np.eye(4)
    T[:3, 0], T[:3, 1], T[:3, 2] = right, np.cross(up, right), up
    T[:3, 3] = np.array([*xy_m, height]) + THICKNESS_M * up
    return FloorMarker(sheet=sheet, T_world_sheet=T, reach_m=_reach_m(cloud, T[:3, 3]))


def _reach_m(cloud: GaussianCloud, centre_m: Float64Array) -> float:
    off_m = np.abs(cloud.means_m - centre_m)
    near = (np.hypot(off_m[:, 0], off_m[:, 1]) < _BESIDE_M) & (off_m[:, 2] < _HIDES_FROM_M)
    largest_m = cloud.scales_m[near].max(axis=1)
    return _REACH_SIGMAS * float(np.quantile(largest_m, _REACH_SHARE)) if len(largest_m) else 0.0


class MarkedRasterizer:
    """Draws a scene with a marker on its floor.

    Args:
        scene: Rasterizer of the scene, with median depths.
        camera: Camera of the images.
        marker: The marker; only its colours are drawn, depths stay those of the scene.
    """

    def __init__(self, scene: Rasterizer, camera: PinholeCamera, marker: FloorMarker) -> None:
        self._scene, self._marker, self._K_px = scene, marker, np.asarray(camera.K_px, dtype=np.float64)

    @property
    def views_at_once(self) -> int:
        """Number of views that the scene's rasterizer draws at once."""
        return self._scene.views_at_once

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        """Draw views of the scene with the marker; arguments as in `Rasterizer.render`."""
        drawn = self._scene.render(views, tuple(dict.fromkeys([*outputs, "rgb", "median_depth"])))
        rgb, depth_m = drawn.rgb.copy(), drawn.median_depth_m
        assert depth_m is not None
        for number, view in enumerate(views):
            draw_marker(rgb[number], depth_m[number], self._marker, view.T_world_camera, self._K_px)
        wanted = {FIELDS[name] for name in outputs}
        return Images(**{**{name: value for name, value in drawn.arrays().items() if name in wanted}, "rgb": rgb})


def draw_marker(
    rgb: UInt8Array,
    depth_m: Float32Array,
    marker: FloorMarker,
    T_world_camera: Float64Array,
    K_px: Float64Array,
) -> None:
    """Draw a marker into a pinhole image of the scene.

    Args:
        rgb: The image as sRGB, shape (H, W, 3); is changed.
        depth_m: Median depth of the scene [m], shape (H, W).
        marker: The marker.
        T_world_camera: Pose of the camera, shape (4, 4).
        K_px: Its intrinsics [px], pixel centres at +0.5, shape (3, 3).
    """
    T_sheet_camera = np.linalg.inv(marker.T_world_sheet) @ T_world_camera
    window = _window(marker, T_world_camera, K_px, rgb.shape[:2])
    if window is None or T_sheet_camera[2, 3] <= 0.0:
        return
    top, bottom, left, right = window
    rays = _rays(window, K_px) @ T_sheet_camera[:3, :3].T
    with np.errstate(divide="ignore", invalid="ignore"):
        ahead = np.where(rays[..., 2] < 0.0, -T_sheet_camera[2, 3] / rays[..., 2], np.inf)
        light, inside = marker.light_at(rays[..., :2] * ahead[..., None] + T_sheet_camera[:2, 3])
    inside &= np.isfinite(ahead)
    share = inside.mean(axis=(2, 3))
    paper = np.where(inside, light, 0.0).mean(axis=(2, 3))
    middle = rays.mean(axis=(2, 3))
    rise_m = middle[..., 2] * depth_m[top:bottom, left:right] + T_sheet_camera[2, 3]
    reach_m = marker.reach_m * np.abs(middle[..., 2]) / np.linalg.norm(middle, axis=-1)
    hidden = np.clip((rise_m - np.maximum(_HIDES_FROM_M, reach_m)) / _HIDES_OVER_M, 0.0, 1.0)
    seen, kept = paper * (1.0 - hidden), 1.0 - share * (1.0 - hidden)
    part = rgb[top:bottom, left:right]
    drawn_light = kept[..., None] * (light_of_byte()[part] / LIGHT_ONE) + seen[..., None]
    drawn = byte_of_light()[np.clip(np.rint(drawn_light * LIGHT_ONE), 0, LIGHT_ONE).astype(np.int64)]
    part[:] = np.where((share > 0.0)[..., None], drawn, part)


def _window(
    marker: FloorMarker, T_world_camera: Float64Array, K_px: Float64Array, shape: tuple[int, ...]
) -> tuple[int, int, int, int] | None:
    """Rows and columns of the image that may show the sheet: top, bottom, left, right; None if it is out of view."""
    points = (marker.outline_m - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    if (points[:, 2] < _NEAR_M).all():
        return None
    low, high = np.zeros(2), np.array([shape[1], shape[0]], dtype=np.float64)
    if (points[:, 2] >= _NEAR_M).all():
        uv = points @ K_px.T
        uv = uv[:, :2] / uv[:, 2:]
        low, high = np.maximum(np.floor(uv.min(axis=0)) - 1, low), np.minimum(np.ceil(uv.max(axis=0)) + 1, high)
    if (low >= high).any():
        return None
    return int(low[1]), int(high[1]), int(low[0]), int(high[0])


def _rays(window: tuple[int, int, int, int], K_px: Float64Array) -> Float64Array:
    """Rays of depth 1 through `_SAMPLES`^2 points of each pixel, shape (h, w, S, S, 3)."""
    top, bottom, left, right = window
    within = (np.arange(_SAMPLES) + 0.5) / _SAMPLES
    u = (np.arange(left, right)[:, None] + within - K_px[0, 2]) / K_px[0, 0]
    v = (np.arange(top, bottom)[:, None] + within - K_px[1, 2]) / K_px[1, 1]
    shape = (bottom - top, right - left, _SAMPLES, _SAMPLES)
    x, y = np.broadcast_to(u[None, :, None, :], shape), np.broadcast_to(v[:, None, :, None], shape)
    return np.stack([x, y, np.ones(shape)], axis=-1)
