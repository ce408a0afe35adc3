"""Soft shadows under feet: dark flat Gaussians on the floor, drawn with the scene.

A pixel's Gaussians are blended in the order of their centres' depths, and those of a floor are as large as a foot, so
that a shadow just above them would be half hidden. Each shadow Gaussian is therefore small, and pulled towards the
camera along its own ray with its size in proportion: the image shows it in the same place, before the floor that it
lies on. Where a foot stands in that way, the shadow stays behind the foot.

Legend: P = shadow Gaussians, F = feet.
"""

import math
from collections.abc import Iterator, Mapping, Sequence

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import Avatar
from readygo.common.avatars.kinematics import fill_globals
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.maps import FloorMap
from readygo.common.rasterizer.interface import PosedHuman

Floats = npt.NDArray[np.float64]

FEET = ((7, 10), (8, 11))
"""SMPL joints of each foot: ankle and ball."""
FADE_M = 0.25
"""A sole this high above the floor casts no shadow any more."""
LIFT_M = 0.004
"""Above the floor map, which follows the visible surface."""
PULL_M = 0.3
"""Towards the camera: two standard deviations of a large Gaussian of a floor and of one of the shadow."""
PULL_BESIDE_M = 0.02
"""The same where a foot is in the way."""
NEAREST_M = 0.4
"""Shadows nearer to the camera are left out: there is no room to pull them."""
SPREAD = 0.3
"""Growth of a shadow with the height of the sole."""
_HEEL_M, _TIP_M, _HALF_WIDTH_M = 0.07, 0.09, 0.035
"""How far a foot reaches behind its ankle, before its ball, and to its sides."""
_ROWS = ((-0.09, 0.05, 0.09), (-0.045, 0.032, 0.22), (0.0, 0.032, 0.22), (0.045, 0.032, 0.22), (0.09, 0.05, 0.09))
"""Rows of Gaussians along a foot: place to its left [m], standard deviation [m], opacity on the ground."""
_ALONG = 7
_DARK_SH = -0.5 / SH_C0
"""SH of black."""


def shadow_cloud(
    avatars: Mapping[str, Avatar], humans: Sequence[PosedHuman], floor: FloorMap, p_WC: Floats
) -> GaussianCloud | None:
    """The shadows of humans as a camera at `p_WC` [m] is to draw them; None if nobody casts one."""
    feet = [foot for human in humans for foot in _feet(avatars[human.avatar], human)]
    if not feet:
        return None
    ends = np.array([foot[:2] for foot in feet])
    xy, sole_m, sigma_m, opacity = _laid_out(ends, np.array([foot[2] for foot in feet]))
    floor_m = floor.at_many(xy)
    height_m = np.maximum(sole_m - floor_m, 0.0)
    grown = sigma_m + SPREAD * height_m
    # The same shade on more ground is thinner.
    shade = opacity * (1.0 - np.minimum(height_m / FADE_M, 1.0)) ** 2 * (sigma_m / grown) ** 2
    towards = p_WC - np.column_stack([xy, floor_m + LIFT_M])
    distance = np.sqrt(towards[:, 0] ** 2 + towards[:, 1] ** 2 + towards[:, 2] ** 2)
    kept = (shade > 1.0 / 255.0) & (distance > NEAREST_M)
    if not kept.any():
        return None
    pull = (_free_way(xy, towards[:, :2], ends) / distance)[:, None]
    means = np.column_stack([xy, floor_m + LIFT_M]) + towards * pull
    scales = (grown[:, None] * (1.0 - pull)) * (1.0, 1.0, 0.05)
    count = len(means)
    cloud = GaussianCloud(
        means_m=means.astype(np.float32),
        quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (count, 1)),
        scales_m=scales.astype(np.float32),
        opacities=shade.astype(np.float32),
        sh=np.full((count, 1, 3), _DARK_SH, dtype=np.float32),
    )
    return cloud.select(kept)


def _feet(avatar: Avatar, human: PosedHuman) -> Iterator[tuple[list[float], list[float], list[float]]]:
    """Heel and tip on the ground [m], and the heights of the sole there [m], of each foot."""
    positions, rotations = np.empty((24, 3)), np.empty((24, 3, 3))
    root, pose = human.root_m.astype(np.float64), human.pose_axis_angle.astype(np.float64)
    fill_globals(root, pose, avatar.joints_tpose_m, rotations, positions)
    for ankle, ball in FEET:
        (ax, ay, az), (bx, by, bz) = positions[ankle].tolist(), positions[ball].tolist()
        length = max(math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay)), 1e-3)
        ux, uy = (bx - ax) / length, (by - ay) / length
        soles = [z - float(avatar.joints_canonical_m[joint, 1]) for z, joint in ((az, ankle), (bz, ball))]
        yield [ax - _HEEL_M * ux, ay - _HEEL_M * uy], [bx + _TIP_M * ux, by + _TIP_M * uy], soles


def _laid_out(ends: Floats, soles_m: Floats) -> tuple[Floats, Floats, Floats, Floats]:
    """Gaussians along feet.

    Args:
        ends: Heels and tips [m], shape (F, 2, 2).
        soles_m: Heights of the sole there [m], shape (F, 2).

    Returns:
        Places on the ground (P, 2), heights of the sole (P,), standard deviations (P,), all [m], and opacities (P,).
    """
    share = (np.arange(_ALONG) / (_ALONG - 1))[None, :, None]
    left_m, sigma_m, opacity = np.array(_ROWS).T
    way = ends[:, 1] - ends[:, 0]
    ahead = way / np.sqrt(way[:, :1] * way[:, :1] + way[:, 1:] * way[:, 1:])
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    middle = ends[:, :1] + share * way[:, None]
    xy = middle[:, :, None] + left_m[None, None, :, None] * aside[:, None, None]
    sole_m = soles_m[:, :1] + share[..., 0] * (soles_m[:, 1:] - soles_m[:, :1])
    shape = xy.shape[:3]
    flat = [np.broadcast_to(values, shape).reshape(-1) for values in (sole_m[..., None], sigma_m, opacity)]
    return xy.reshape(-1, 2), flat[0], flat[1], flat[2]


def _free_way(xy: Floats, towards: Floats, ends: Floats) -> Floats:
    """How far Gaussians can be pulled before a foot is in the way [m], shape (P,).

    Args:
        xy: Places on the ground [m], shape (P, 2).
        towards: Where the camera is from there [m], shape (P, 2).
        ends: Heels and tips [m], shape (F, 2, 2).
    """
    ahead = towards / np.sqrt(towards[:, :1] * towards[:, :1] + towards[:, 1:] * towards[:, 1:])
    free = np.full(len(xy), PULL_M)
    for way_m in np.arange(PULL_M, -1e-9, -PULL_BESIDE_M).tolist():
        points = xy + way_m * ahead
        blocked = np.zeros(len(xy), dtype=np.bool_)
        for heel, tip in ends:
            blocked |= _inside(points, heel, tip)
        free[blocked] = max(way_m - PULL_BESIDE_M, PULL_BESIDE_M)
    return free


def _inside(points: Floats, heel: Floats, tip: Floats) -> npt.NDArray[np.bool_]:
    """Whether points on the ground are below a foot, shape (P,)."""
    way, from_heel = tip - heel, points - heel
    length2 = float(way[0] * way[0] + way[1] * way[1])
    along = from_heel[:, 0] * way[0] + from_heel[:, 1] * way[1]
    aside = from_heel[:, 1] * way[0] - from_heel[:, 0] * way[1]
    beside = aside * aside <= length2 * _HALF_WIDTH_M * _HALF_WIDTH_M
    inside: npt.NDArray[np.bool_] = (along >= 0) & (along <= length2) & beside
    return inside
