"""A scene from straight above, without its ceiling: the background of plans and reports."""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.gaussians import GaussianCloud, sh_basis
from readygo.common.gaussians.covariance import covariance_of
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps.grid import FloorMap, GridFrame
from readygo.common.scenes.scene import Scene

CEILING_M = 1.8
"""Gaussians higher above the local floor are left out [m]."""
BACKGROUND = 0.93
_OPACITY_MIN = 0.05
_SIGMAS = 3.0
_DILATION_PX2 = 0.3


@dataclass(frozen=True, kw_only=True, eq=False)
class TopView:
    """A picture from above. Its row 0 is the LARGEST y (pictures grow downwards), unlike the rows of maps."""

    rgb: UInt8Array
    """Shape (H, W, 3)."""
    frame: GridFrame
    """Origin is the world x, y of the picture's lower left corner; the resolution is a pixel's edge."""

    def world_to_pixel(self, xy_m: npt.ArrayLike) -> Float64Array:
        """Pixels (u, v) of world points, shape (..., 2) -> (..., 2); pixel centres are at +0.5."""
        xy = np.asarray(xy_m, dtype=np.float64)
        u = (xy[..., 0] - self.frame.origin_x_m) / self.frame.resolution_m
        v = len(self.rgb) - (xy[..., 1] - self.frame.origin_y_m) / self.frame.resolution_m
        return np.stack([u, v], axis=-1)


def top_view(scene: Scene, resolution_m: float = 0.02) -> TopView:
    """The extent of a scene's maps from above.

    Args:
        scene: Scene bundle; reads its Gaussians.
        resolution_m: Edge of a pixel [m].
    """
    occupancy = scene.maps.robot
    rows, columns = (max(1, round(n * occupancy.frame.resolution_m / resolution_m)) for n in occupancy.occupied.shape)
    frame = replace(occupancy.frame, resolution_m=resolution_m)
    return draw_top_view(scene.cloud, scene.maps.floor, frame, (rows, columns))


def draw_top_view(
    cloud: GaussianCloud,
    floor: FloorMap,
    frame: GridFrame,
    shape: tuple[int, int],
    *,
    ceiling_m: float = CEILING_M,
) -> TopView:
    """Draw a cloud orthographically from above, lowest Gaussians first.

    Args:
        cloud: Gaussians, metres, z up.
        floor: Local floor, which the ceiling is cut above.
        frame: Lower left corner and size of the pixels.
        shape: Rows and columns of the picture.
        ceiling_m: Height of the cut above the local floor [m].
    """
    height_m = cloud.means_m[:, 2] - floor.at_many(cloud.means_m[:, :2].astype(np.float64))
    kept = np.nonzero((height_m < ceiling_m) & (cloud.opacities > _OPACITY_MIN))[0]
    shown = cloud.select(kept[np.argsort(height_m[kept], kind="stable")])
    downwards = sh_basis([[0.0, 0.0, -1.0]], cloud.sh_degree)[0]
    colours = np.maximum(0.5 + np.einsum("k,nkc->nc", downwards, shown.sh.astype(np.float64)), 0.0)
    image = np.full((*shape, 3), BACKGROUND)
    origin = (float(frame.origin_x_m), float(frame.origin_y_m))
    _paint(shown.means_m, shown.quats_wxyz, shown.scales_m, shown.opacities, colours, origin, frame.resolution_m, image)
    rgb = np.rint(255 * np.clip(image[::-1], 0.0, 1.0)).astype(np.uint8)
    return TopView(rgb=np.ascontiguousarray(rgb), frame=frame)


@kernel_with_cache
def _paint(
    means: Float32Array,
    quats: Float32Array,
    scales: Float32Array,
    opacities: Float32Array,
    colours: Float64Array,
    origin: tuple[float, float],
    pixel_m: float,
    image: Float64Array,
) -> None:
    """Blend the Gaussians over each other in order; row 0 is the smallest y."""
    rows, columns, _ = image.shape
    for n in range(len(means)):
        x, y = (means[n, 0] - origin[0]) / pixel_m, (means[n, 1] - origin[1]) / pixel_m
        far = _SIGMAS * (max(scales[n, 0], scales[n, 1], scales[n, 2]) / pixel_m + 1.0)
        if x + far < 0 or y + far < 0 or x - far > columns or y - far > rows:
            continue
        S = covariance_of(quats[n, 0], quats[n, 1], quats[n, 2], quats[n, 3], scales[n, 0], scales[n, 1], scales[n, 2])
        a = S[0] / pixel_m**2 + _DILATION_PX2
        b = S[1] / pixel_m**2
        c = S[3] / pixel_m**2 + _DILATION_PX2
        det = a * c - b * b
        wide, tall = _SIGMAS * math.sqrt(a), _SIGMAS * math.sqrt(c)
        for i in range(max(0, math.floor(y - tall)), min(rows, math.ceil(y + tall))):
            v = i + 0.5 - y
            for j in range(max(0, math.floor(x - wide)), min(columns, math.ceil(x + wide))):
                u = j + 0.5 - x
                alpha = opacities[n] * math.exp(-0.5 * (c * u * u - 2 * b * u * v + a * v * v) / det)
                if alpha < 1 / 255:
                    continue
                for channel in range(3):
                    image[i, j, channel] += alpha * (colours[n, channel] - image[i, j, channel])
