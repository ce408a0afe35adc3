"""What a camera shows of the ground around its robot."""

import math
from functools import cache
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.camera.config import CameraConfig
from readygo.common.camera.lens import make_lens

BODY_M = 1.9
"""Humans reach from the floor to this height [m]."""


class FieldOfView(NamedTuple):
    """The borders of a camera's image, behind its lens, as seen from the camera's place on the ground.

    A named tuple, so that compiled functions take it as well.
    """

    left_rad: float
    """Bearing of the left border at the camera's own height, from the camera's heading to the left [rad]."""
    right_rad: float
    """Bearing of the right border at the camera's own height, from the camera's heading to the right [rad]."""
    rise: float
    """Height of the upper border above the camera, at the middle of the image, per distance."""
    fall: float
    """Height of the lower border above the camera, at the middle of the image, per distance; negative unless the camera
    looks up."""
    height_m: float
    """Height of the camera above the floor [m]."""


@cache
def view_of(camera: CameraConfig) -> FieldOfView:
    """The view of a camera.

    Raises:
        ConfigError: If the lens folds the image.
    """
    width, height = camera.width_px, camera.height_px
    rows = np.linspace(0.0, height, 2 * height + 1)
    if camera.horizontal_fov_deg is not None and camera.mount_pitch_deg == 0.0:
        left_rad = right_rad = math.radians(camera.horizontal_fov_deg) / 2
    else:
        left_rad = _bearing_rad(camera, np.stack([np.zeros_like(rows), rows], axis=1))
        right_rad = -_bearing_rad(camera, np.stack([np.full_like(rows, width), rows], axis=1))
    ends = _level_rays(camera, np.array([[camera.K_px[0, 2], 0.0], [camera.K_px[0, 2], height]]))
    rise, fall = (up / ahead if ahead > 1e-9 else math.copysign(math.inf, up) for ahead, _, up in ends.tolist())
    return FieldOfView(left_rad=left_rad, right_rad=right_rad, rise=rise, fall=fall, height_m=camera.mount_height_m)


def in_view(
    eye: tuple[float, float, float], x_m: float, y_m: float, view: FieldOfView, range_m: float, radius_m: float
) -> bool:
    """True if some part of a human at (x, y) lies in a camera's view and range.

    Plain arithmetic, which numba compiles for compiled callers.

    Args:
        eye: Camera's x [m], y [m] and yaw [rad], see `CameraConfig.eye`.
        x_m: Centre of the disc [m].
        y_m: Centre of the disc [m].
        view: What the camera shows.
        range_m: Largest distance of the centre [m].
        radius_m: Radius of the disc [m].
    """
    dx, dy = x_m - eye[0], y_m - eye[1]
    distance_m = math.sqrt(dx * dx + dy * dy)
    if distance_m > range_m:
        return False
    if distance_m <= radius_m:
        return True
    bearing_rad = (math.atan2(dy, dx) - eye[2] + math.pi) % (2 * math.pi) - math.pi
    half_rad = math.asin(radius_m / distance_m)
    across = bearing_rad - half_rad <= view.left_rad and -bearing_rad - half_rad <= view.right_rad
    low_m, high_m = view.height_m + view.fall * distance_m, view.height_m + view.rise * distance_m
    return across and low_m <= BODY_M and high_m >= 0.0


def _bearing_rad(camera: CameraConfig, border_px: Float64Array) -> float:
    """Bearing to the left of a border, where it is nearest to the horizon [rad]."""
    rays = _level_rays(camera, border_px)
    ahead, left, _ = rays[np.argmin(np.abs(rays[:, 2]) / np.hypot(rays[:, 0], rays[:, 1]))].tolist()
    return math.atan2(left, ahead)


def _level_rays(camera: CameraConfig, uv_px: Float64Array) -> Float64Array:
    """Rays of pixels with x along the camera's heading, y left, z up, shape (N, 2) -> (N, 3)."""
    x, y = make_lens(camera).rays(uv_px).T
    R_robot_camera = camera.T_world_camera(0.0, 0.0, -math.radians(camera.mount_yaw_deg), 0.0)[:3, :3]
    rays: Float64Array = np.stack([x, y, np.ones_like(x)], axis=1) @ R_robot_camera.T
    return rays
