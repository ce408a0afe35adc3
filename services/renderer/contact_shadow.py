"""Soft shadows under feet: dark flat Gaussians on the floor, drawn with the scene.

A pixel's Gaussians are blended in the order of their centres' depths, and those of a floor are as large as a foot, so
that a shadow just above them would be half hidden. Each shadow Gaussian is therefore small, and pulled towards the
camera along its own ray with its size in proportion: the image shows it in the same place, before the floor that it
lies on. Where a foot stands in that way, the shadow stays behind the foot.
"""

import math

import numpy as np
import numpy.typing as npt

from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.kernels import compiled
from readygo.common.maps import FloorMap
from readygo.common.maps.grid import bilinear

Floats = npt.NDArray[np.float64]
Singles = npt.NDArray[np.float32]

FADE_M = 0.25
"""A sole this high above the floor casts no shadow any more."""
LIFT_M = 0.004
"""Height of the shadows above the floor map, which follows the visible surface [m]."""
PULL_M = 0.3
"""Shift of the shadows towards the camera [m]: two standard deviations of a large Gaussian of a floor and of one of the
shadow."""
PULL_BESIDE_M = 0.02
"""Shift of the shadows towards the camera where a foot is in the way [m]."""
NEAREST_M = 0.4
"""Shadows nearer to the camera are left out: there is no room to pull them."""
SPREAD = 0.3
"""Growth of a shadow with the height of the sole."""
_HALF_WIDTH_M = 0.035
"""How far a foot reaches to its sides."""
_ROWS = ((-0.09, 0.05, 0.09), (-0.045, 0.032, 0.22), (0.0, 0.032, 0.22), (0.045, 0.032, 0.22), (0.09, 0.05, 0.09))
"""Rows of Gaussians along a foot: place to its left [m], standard deviation [m], opacity on the ground."""
_ALONG = 7
_STEPS = round(PULL_M / PULL_BESIDE_M)
_DARK_SH = np.float32(-0.5 / SH_C0)
"""SH coefficient of black."""


def shadow_cloud(feet: Floats, floor: FloorMap, p_WC: Floats) -> GaussianCloud | None:
    """The shadows of feet as a camera is to draw them; None if there are none.

    Args:
        feet: Of `feet_of`, shape (H, 2, 2, 3).
        floor: Height of the floor.
        p_WC: The camera in the world [m], shape (3,).
    """
    feet = feet.reshape(-1, 2, 3)
    room = len(feet) * _ALONG * len(_ROWS)
    means, scales = np.empty((room, 3), dtype=np.float32), np.empty((room, 3), dtype=np.float32)
    opacities, frame = np.empty(room, dtype=np.float32), floor.frame
    grid = floor.height_m, frame.origin_x_m, frame.origin_y_m, frame.resolution_m
    count = _fill_shadows(feet, *grid, p_WC, means, scales, opacities)
    if count == 0:
        return None
    upright, dark = np.zeros((count, 4), dtype=np.float32), np.full((count, 1, 3), _DARK_SH)
    upright[:, 0] = 1.0
    return GaussianCloud(
        means_m=means[:count],
        quats_wxyz=upright,
        scales_m=scales[:count],
        opacities=opacities[:count],
        sh=dark,
    )


@compiled
def _fill_shadows(
    feet: Floats,
    floor_m: Singles,
    origin_x_m: float,
    origin_y_m: float,
    resolution_m: float,
    p_WC: Floats,
    means: Singles,
    scales: Singles,
    opacities: Singles,
) -> int:
    """Write the shadow Gaussians of feet, shape (F, 2, 3), and return their number."""
    count = 0
    for foot in range(len(feet)):
        wx, wy = feet[foot, 1, 0] - feet[foot, 0, 0], feet[foot, 1, 1] - feet[foot, 0, 1]
        length = math.sqrt(wx * wx + wy * wy)
        for k in range(_ALONG):
            share = k / (_ALONG - 1)
            sole_m = feet[foot, 0, 2] + share * (feet[foot, 1, 2] - feet[foot, 0, 2])
            for left_m, sigma_m, opacity in _ROWS:
                x = feet[foot, 0, 0] + share * wx - left_m * wy / length
                y = feet[foot, 0, 1] + share * wy + left_m * wx / length
                ground_m = bilinear(floor_m, origin_x_m, origin_y_m, resolution_m, x, y)
                height_m = max(sole_m - ground_m, 0.0)
                grown_m = sigma_m + SPREAD * height_m
                # The same shade on more ground is thinner.
                left_over, thinner = 1.0 - min(height_m / FADE_M, 1.0), sigma_m / grown_m
                shade = opacity * left_over * left_over * thinner * thinner
                tx, ty, tz = p_WC[0] - x, p_WC[1] - y, p_WC[2] - (ground_m + LIFT_M)
                distance = math.sqrt(tx * tx + ty * ty + tz * tz)
                if shade <= 1.0 / 255.0 or distance <= NEAREST_M:
                    continue
                pull = _free_way(feet, x, y, tx, ty) / distance
                means[count, 0], means[count, 1] = x + tx * pull, y + ty * pull
                means[count, 2] = ground_m + LIFT_M + tz * pull
                scales[count, 0] = scales[count, 1] = grown_m * (1.0 - pull)
                scales[count, 2] = 0.05 * grown_m * (1.0 - pull)
                opacities[count] = shade
                count += 1
    return count


@compiled
def _free_way(feet: Floats, x: float, y: float, towards_x: float, towards_y: float) -> float:
    """How far a Gaussian at (x, y) [m] can be pulled towards the camera before a foot is in the way [m]."""
    length = math.sqrt(towards_x * towards_x + towards_y * towards_y)
    ux, uy = towards_x / length, towards_y / length
    for step in range(_STEPS + 1):
        way_m = step * PULL_BESIDE_M
        for foot in range(len(feet)):
            if _is_inside(feet[foot], x + way_m * ux, y + way_m * uy):
                return max(way_m - PULL_BESIDE_M, PULL_BESIDE_M)
    return PULL_M


@compiled
def _is_inside(foot: Floats, x: float, y: float) -> bool:
    """Whether a point on the ground is below a foot."""
    wx, wy = foot[1, 0] - foot[0, 0], foot[1, 1] - foot[0, 1]
    px, py = x - foot[0, 0], y - foot[0, 1]
    length2, along, aside = wx * wx + wy * wy, px * wx + py * wy, py * wx - px * wy
    return bool(0.0 <= along <= length2 and aside * aside <= length2 * _HALF_WIDTH_M * _HALF_WIDTH_M)
