"""Humans as they are drawn: in their poses between the steps of their motions, with feet and shadows on the floor.

A pixel's Gaussians are blended in the order of their centres' depths, and those of a floor are as large as a foot. Feet
are therefore sorted as nearer than they are. Shadows are dark flat Gaussians, drawn with the scene; one just above the
floor would be half hidden. Each is therefore small, and pulled towards the camera along its own ray with its size in
proportion: the image shows it in the same place, before the floor that it lies on. Where a foot stands in that way, the
shadow stays behind the foot.
"""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.avatars import Avatar
from readygo.common.avatars.kinematics import fill_globals
from readygo.common.frames.turning import turn_between
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.kernels import kernel_with_cache
from readygo.common.maps import FloorMap, OccupancyMap
from readygo.common.maps.grid import bilinear
from readygo.common.messages import HumanMotion
from readygo.common.rasterizer.interface import PosedHuman

FEET = ((7, 10), (8, 11))
"""SMPL joints of each foot: ankle and ball."""
LEAD_SHARE, LEAD_MAX_M = 0.15, 1.0
"""Gaussians of a floor hide feet that stand on it from no further before them: a share of the distance, as the view is
the more grazing. With a share of 0.15 humans keep their order among each other for cameras up to 1.6 m high."""
_STEP_M = 0.05
_HEEL_M, _TIP_M = 0.07, 0.09
"""How far a foot reaches behind its ankle, and before its ball."""
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
"""Rows of a shadow's Gaussians along a foot: place to its left [m], standard deviation [m], opacity on the ground."""
_ALONG = 7
"""Gaussians in each row."""
_PULL_STEPS = round(PULL_M / PULL_BESIDE_M)
_DARK_SH = np.float32(-0.5 / SH_C0)
"""SH coefficient of black."""


def pose_humans(humans: Sequence[HumanMotion], step: float) -> tuple[PosedHuman, ...]:
    """Humans at a step, which need not be whole: between rows the root moves straight, every joint about one axis."""
    posed = []
    for human in humans:
        root_m, pose = human.motion.root_m, human.motion.pose_axis_angle
        row, share = row_and_share(step, len(root_m))
        root, joints = root_m[row], pose[row]
        if share > 0.0:
            root = root + np.float32(share) * (root_m[row + 1] - root)
            joints = np.empty((24, 3), dtype=np.float32)
            turn_between(pose[row], pose[row + 1], share, joints)
        posed.append(PosedHuman(avatar=human.avatar, root_m=root, pose_axis_angle=joints))
    return tuple(posed)


def row_and_share(step: float, count: int) -> tuple[int, float]:
    """The row before a step and the share of the time to the next one; the first and last of `count` rows are held."""
    if step >= count - 1:
        return count - 1, 0.0
    row = max(math.floor(step), 0)
    return row, max(step - row, 0.0)


def feet_of(avatars: Mapping[str, Avatar], humans: Sequence[PosedHuman]) -> Float64Array:
    """Heel and tip of everybody's feet: x, y and the height of the sole there [m], shape (H, 2, 2, 3)."""
    feet = np.empty((len(humans), 2, 2, 3))
    for number, human in enumerate(humans):
        avatar = avatars[human.avatar]
        root, pose = human.root_m.astype(np.float64), human.pose_axis_angle.astype(np.float64)
        _fill_feet(root, pose, avatar.joints_tpose_m, avatar.joints_canonical_m, feet[number])
    return feet


def stands_of(
    feet: Float64Array, floor: FloorMap, obstacles: OccupancyMap, T_world_camera: Float64Array
) -> Float64Array:
    """The ground below humans, and by how much their feet can be drawn as if they were nearer to a camera.

    Args:
        feet: See `feet_of`, shape (H, 2, 2, 3).
        floor: Height of the floor.
        obstacles: What stands on it: feet are not drawn before it.
        T_world_camera: Camera pose, OpenCV axes, shape (4, 4).

    Returns:
        World z [m], and depth along the optical axis [m] from 0 to `LEAD_MAX_M`, shape (H, 2).
    """
    stands = np.empty((len(feet), 2))
    frame, grid = floor.frame, obstacles.frame
    _fill_grounds(feet, floor.height_m, frame.origin_x_m, frame.origin_y_m, frame.resolution_m, stands)
    place = grid.origin_x_m, grid.origin_y_m, grid.resolution_m
    _fill_leads(feet.reshape(-1, 4, 3), obstacles.occupied, *place, T_world_camera, stands)
    return stands


def shadow_cloud(feet: Float64Array, floor: FloorMap, p_WC: Float64Array) -> GaussianCloud | None:
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


@kernel_with_cache
def _fill_feet(
    root: Float64Array,
    pose: Float64Array,
    joints_tpose: Float32Array,
    joints_canonical: Float32Array,
    feet: Float64Array,
) -> None:
    """Write heel and tip of both feet, shape (2, 2, 3)."""
    positions, rotations = np.empty((24, 3)), np.empty((24, 3, 3))
    fill_globals(root, pose, joints_tpose, rotations, positions)
    for foot in range(2):
        ankle, ball = FEET[foot]
        ax, ay, bx, by = positions[ankle, 0], positions[ankle, 1], positions[ball, 0], positions[ball, 1]
        length = max(math.sqrt((bx - ax) * (bx - ax) + (by - ay) * (by - ay)), 1e-3)
        ux, uy = (bx - ax) / length, (by - ay) / length
        feet[foot, 0, 0], feet[foot, 0, 1] = ax - _HEEL_M * ux, ay - _HEEL_M * uy
        feet[foot, 1, 0], feet[foot, 1, 1] = bx + _TIP_M * ux, by + _TIP_M * uy
        feet[foot, 0, 2] = positions[ankle, 2] - float(joints_canonical[ankle, 1])
        feet[foot, 1, 2] = positions[ball, 2] - float(joints_canonical[ball, 1])


@kernel_with_cache
def _fill_grounds(
    feet: Float64Array,
    floor_m: Float32Array,
    origin_x_m: float,
    origin_y_m: float,
    resolution_m: float,
    stands: Float64Array,
) -> None:
    for human in range(len(feet)):
        x, y = feet[human, :, :, 0].mean(), feet[human, :, :, 1].mean()
        stands[human, 0] = bilinear(floor_m, origin_x_m, origin_y_m, resolution_m, x, y)


@kernel_with_cache
def _fill_leads(
    points: Float64Array,
    occupied: BoolArray,
    origin_x_m: float,
    origin_y_m: float,
    resolution_m: float,
    T_world_camera: Float64Array,
    stands: Float64Array,
) -> None:
    """Write the leads of humans whose feet span the points of shape (H, P, 3): the least of all of them."""
    for human in range(len(points)):
        stands[human, 1] = LEAD_MAX_M
        for k in range(points.shape[1]):
            x, y = points[human, k, 0], points[human, k, 1]
            tx, ty = T_world_camera[0, 3] - x, T_world_camera[1, 3] - y
            length = max(math.sqrt(tx * tx + ty * ty), 1e-6)
            ux, uy = tx / length, ty / length
            wanted_m, free_m = min(LEAD_SHARE * length, LEAD_MAX_M), 0.0
            while free_m < wanted_m:
                row = math.floor((y + (free_m + _STEP_M) * uy - origin_y_m) / resolution_m)
                column = math.floor((x + (free_m + _STEP_M) * ux - origin_x_m) / resolution_m)
                inside = 0 <= row < occupied.shape[0] and 0 <= column < occupied.shape[1]
                if inside and occupied[row, column]:
                    break
                free_m += _STEP_M
            along = max(-(ux * T_world_camera[0, 2] + uy * T_world_camera[1, 2]), 0.0)
            stands[human, 1] = min(stands[human, 1], min(free_m, wanted_m) * along)


@kernel_with_cache
def _fill_shadows(
    feet: Float64Array,
    floor_m: Float32Array,
    origin_x_m: float,
    origin_y_m: float,
    resolution_m: float,
    p_WC: Float64Array,
    means: Float32Array,
    scales: Float32Array,
    opacities: Float32Array,
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


@kernel_with_cache
def _free_way(feet: Float64Array, x: float, y: float, towards_x: float, towards_y: float) -> float:
    """How far a Gaussian at (x, y) [m] can be pulled towards the camera before a foot is in the way [m]."""
    length = math.sqrt(towards_x * towards_x + towards_y * towards_y)
    ux, uy = towards_x / length, towards_y / length
    for step in range(_PULL_STEPS + 1):
        way_m = step * PULL_BESIDE_M
        for foot in range(len(feet)):
            if _is_inside(feet[foot], x + way_m * ux, y + way_m * uy):
                return max(way_m - PULL_BESIDE_M, PULL_BESIDE_M)
    return PULL_M


@kernel_with_cache
def _is_inside(foot: Float64Array, x: float, y: float) -> bool:
    """Whether a point on the ground is below a foot."""
    wx, wy = foot[1, 0] - foot[0, 0], foot[1, 1] - foot[0, 1]
    px, py = x - foot[0, 0], y - foot[0, 1]
    length2, along, aside = wx * wx + wy * wy, px * wx + py * wy, py * wx - px * wy
    return bool(0.0 <= along <= length2 and aside * aside <= length2 * _HALF_WIDTH_M * _HALF_WIDTH_M)
