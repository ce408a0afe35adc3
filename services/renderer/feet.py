"""Where the feet of humans are, and how far the ground before them is free."""

import math
from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from readygo.common.avatars import Avatar
from readygo.common.avatars.kinematics import fill_globals
from readygo.common.kernels import compiled
from readygo.common.maps import FloorMap, OccupancyMap
from readygo.common.maps.grid import bilinear
from readygo.common.rasterizer.interface import PosedHuman

Floats = npt.NDArray[np.float64]
Singles = npt.NDArray[np.float32]

FEET = ((7, 10), (8, 11))
"""SMPL joints of each foot: ankle and ball."""
LEAD_SHARE, LEAD_MAX_M = 0.15, 1.0
"""Gaussians of a floor hide feet that stand on it from no further before them: a share of the distance, as the view is
the more grazing. With a share of 0.15 humans keep their order among each other for cameras up to 1.6 m high."""
_STEP_M = 0.05
_HEEL_M, _TIP_M = 0.07, 0.09
"""How far a foot reaches behind its ankle, and before its ball."""


def feet_of(avatars: Mapping[str, Avatar], humans: Sequence[PosedHuman]) -> Floats:
    """Heel and tip of everybody's feet: x, y and the height of the sole there [m], shape (H, 2, 2, 3)."""
    feet = np.empty((len(humans), 2, 2, 3))
    for number, human in enumerate(humans):
        avatar = avatars[human.avatar]
        root, pose = human.root_m.astype(np.float64), human.pose_axis_angle.astype(np.float64)
        _fill_feet(root, pose, avatar.joints_tpose_m, avatar.joints_canonical_m, feet[number])
    return feet


def stands_of(feet: Floats, floor: FloorMap, obstacles: OccupancyMap, T_world_camera: Floats) -> Floats:
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


@compiled
def _fill_feet(root: Floats, pose: Floats, joints_tpose: Singles, joints_canonical: Singles, feet: Floats) -> None:
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


@compiled
def _fill_grounds(
    feet: Floats, floor_m: Singles, origin_x_m: float, origin_y_m: float, resolution_m: float, stands: Floats
) -> None:
    for human in range(len(feet)):
        x, y = feet[human, :, :, 0].mean(), feet[human, :, :, 1].mean()
        stands[human, 0] = bilinear(floor_m, origin_x_m, origin_y_m, resolution_m, x, y)


@compiled
def _fill_leads(
    points: Floats,
    occupied: npt.NDArray[np.bool_],
    origin_x_m: float,
    origin_y_m: float,
    resolution_m: float,
    T_world_camera: Floats,
    stands: Floats,
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
