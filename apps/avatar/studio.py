"""The set of an avatar's previews, a wall and a floor with lines, and a sheet of an avatar from all sides."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float32Array, Float64Array, UInt8Array
from readygo.common.avatars import Avatar, joint_positions
from readygo.common.frames import axis_angle_from_matrix, matrix_from_axis_angle
from readygo.common.messages import Motion
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman, View

VIEW_COUNT = 8
CAMERA_DISTANCE_M, CAMERA_HEIGHT_M = 4.2, 1.2
LINE_SPACING_M, LINE_WIDTH_M = 0.5, 0.012
_FLOOR, _LINE, _WALL = (0.70, 0.71, 0.72), (0.40, 0.43, 0.47), (0.84, 0.86, 0.88)
_SHADOW_RADIUS_M, _SHADOW_DEPTH, _SHADOW_FADE_M = 0.13, 0.45, 0.10
_FEET = ((7, 10), (8, 11))


@dataclass(frozen=True, kw_only=True)
class Framing:
    """Size of a picture, and the pinhole camera that takes it."""

    height_px: int
    width_px: int
    focal_px: float

    @property
    def K_px(self) -> Float64Array:
        """Intrinsics [px], shape (3, 3)."""
        return np.array([[self.focal_px, 0, self.width_px / 2], [0, self.focal_px, self.height_px / 2], [0, 0, 1]])


class Studio:
    """One avatar on the floor z = 0 before a camera."""

    def __init__(self, avatar: Avatar, framing: Framing) -> None:
        self.avatar, self.framing = avatar, framing
        self._rasterizer = CpuRasterizer([], {avatar.name: avatar}, framing.K_px, framing.height_px, framing.width_px)

    def picture(self, T_world_camera: Float64Array, motion: Motion, row: int, joints_m: Float64Array) -> UInt8Array:
        """The human in one row of a motion.

        Args:
            T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
            motion: Motion of the human over z = 0.
            row: Row of the motion.
            joints_m: The joints of the whole motion [m], shape (T, 24, 3).

        Returns:
            RGB, shape (H, W, 3).
        """
        human = PosedHuman(
            avatar=self.avatar.name, root_m=motion.root_m[row], pose_axis_angle=motion.pose_axis_angle[row]
        )
        images = self._rasterizer.render([View(T_world_camera=T_world_camera, humans=(human,))], ("alpha",))[0]
        assert images.alpha is not None
        feet = np.stack([0.5 * (joints_m[:, ankle] + joints_m[:, ball]) for ankle, ball in _FEET], axis=1)
        ground = studio_ground(T_world_camera, self.framing, feet[row] - [0.0, 0.0, feet[:, :, 2].min()])
        mixed = images.rgb + (1.0 - images.alpha[:, :, None]) * ground
        return np.clip(np.rint(mixed), 0, 255).astype(np.uint8)


def look_at(eye_m: npt.ArrayLike, target_m: npt.ArrayLike) -> Float64Array:
    """Pose of an upright camera that looks at a target, OpenCV axes, shape (4, 4)."""
    eye = np.asarray(eye_m, dtype=np.float64)
    forward = np.asarray(target_m, dtype=np.float64) - eye
    forward /= np.linalg.norm(forward)
    right = np.cross(forward, (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    T = np.eye(4)
    T[:3, :3] = np.stack([right, np.cross(forward, right), forward], axis=1)
    T[:3, 3] = eye
    return T


def turntable(avatar: Avatar, poses: Sequence[Float32Array]) -> UInt8Array:
    """A sheet with a row of views per pose, the person turning left from image to image.

    Args:
        avatar: Avatar to draw.
        poses: Joint rotations [rad] as in `Motion` for a person that faces SMPL's +z, shape (24, 3) each.

    Returns:
        RGB, shape (len(poses) * 420, 8 * 240, 3).
    """
    studio = Studio(avatar, Framing(height_px=420, width_px=240, focal_px=830.0))
    # In front of the person, who faces -y, looking at the middle of the body.
    camera = look_at((0.0, -CAMERA_DISTANCE_M, CAMERA_HEIGHT_M), (0.0, 0.0, 0.52 * avatar.height_m))
    rows = []
    for pose in poses:
        tiles = []
        for view in range(VIEW_COUNT):
            turned = _turn_pose(pose, 2 * np.pi * view / VIEW_COUNT)
            motion = Motion(root_m=_grounded_root(avatar, turned)[None], pose_axis_angle=turned[None])
            tiles.append(studio.picture(camera, motion, 0, joint_positions(avatar, motion)))
        rows.append(np.concatenate(tiles, axis=1))
    return np.concatenate(rows)


def standing_pose() -> Float32Array:
    """Joint rotations of standing upright, arms down [rad], shape (24, 3)."""
    pose = np.zeros((24, 3), dtype=np.float32)
    pose[16] = (0.0, -0.15, -1.22)
    pose[17] = (0.0, 0.15, 1.22)
    pose[18], pose[19] = (0.0, -0.25, 0.0), (0.0, 0.25, 0.0)
    return pose


def stride_pose() -> Float32Array:
    """Joint rotations of mid-stride, left foot and right arm ahead [rad], shape (24, 3)."""
    pose = standing_pose()
    pose[1], pose[2] = (-0.42, 0.0, 0.0), (0.30, 0.0, 0.0)
    pose[4], pose[5] = (0.10, 0.0, 0.0), (0.45, 0.0, 0.0)
    pose[8] = (0.25, 0.0, 0.0)
    pose[16], pose[17] = _after(pose[16], 0.35), _after(pose[17], -0.40)
    return pose


def _after(axis_angle: Float32Array, swing_rad: float) -> Float32Array:
    """A rotation followed by one about the axis to the body's left."""
    R = matrix_from_axis_angle((swing_rad, 0.0, 0.0)) @ matrix_from_axis_angle(axis_angle)
    return axis_angle_from_matrix(R).astype(np.float32)


def _turn_pose(pose: Float32Array, angle_rad: float) -> Float32Array:
    turned = pose.copy()
    R = matrix_from_axis_angle((0.0, angle_rad, 0.0)) @ matrix_from_axis_angle(pose[0])
    turned[0] = axis_angle_from_matrix(R)
    return turned


def _grounded_root(avatar: Avatar, pose: Float32Array) -> Float32Array:
    """Pelvis position that puts the lower ankle at its height when the person stands on z = 0."""
    motion = Motion(root_m=np.zeros((1, 3), dtype=np.float32), pose_axis_angle=pose[None])
    ankles_m = joint_positions(avatar, motion)[0, [7, 8], 2]
    return np.array([0.0, 0.0, avatar.joints_tpose_m[7, 1] - ankles_m.min()], dtype=np.float32)


def studio_ground(T_world_camera: Float64Array, framing: Framing, feet_m: Float64Array) -> Float64Array:
    """The backdrop: a floor at z = 0 with lines and the shadows of the feet, and a wall.

    Args:
        T_world_camera: Camera pose, OpenCV axes, shape (4, 4).
        framing: The camera.
        feet_m: Middles of the feet [m], shape (2, 3).

    Returns:
        Colours 0..255, shape (H, W, 3).
    """
    u, v = np.meshgrid(np.arange(framing.width_px) + 0.5, np.arange(framing.height_px) + 0.5)
    K_px = framing.K_px
    rays = np.stack([(u - K_px[0, 2]) / K_px[0, 0], (v - K_px[1, 2]) / K_px[1, 1], np.ones_like(u)], axis=-1)
    rays = rays @ T_world_camera[:3, :3].T
    eye = T_world_camera[:3, 3]
    distance = eye[2] / np.maximum(-rays[..., 2], 1e-3)
    points = eye[:2] + distance[..., None] * rays[..., :2]
    floor = _floor_colours(points, distance, eye[2], framing.focal_px)
    for foot in feet_m:
        away = ((points - foot[:2]) ** 2).sum(axis=-1, keepdims=True) / _SHADOW_RADIUS_M**2
        floor *= 1.0 - _SHADOW_DEPTH * np.exp(-away - max(float(foot[2]), 0.0) / _SHADOW_FADE_M)
    haze = np.clip((distance[..., None] - 6.0) / 8.0, 0.0, 1.0)
    wall = np.array(_WALL)
    picture: Float64Array = 255.0 * np.where(rays[..., 2:] < -1e-3, (1 - haze) * floor + haze * wall, wall)
    return picture


def _floor_colours(points: Float64Array, distance: Float64Array, eye_height_m: float, focal_px: float) -> Float64Array:
    """Colours of the floor at points, shape (H, W, 2), with their distances along the rays."""
    # A pixel covers this much floor, along the ray more than across it; lines are blurred to it.
    footprint = (distance / focal_px)[..., None] * np.stack(
        [np.ones_like(distance), np.maximum(distance / eye_height_m, 1.0)], axis=-1
    )
    offset = np.abs((points + 0.5 * LINE_SPACING_M) % LINE_SPACING_M - 0.5 * LINE_SPACING_M)
    cover = np.clip((0.5 * LINE_WIDTH_M + 0.5 * footprint - offset) / footprint, 0.0, 1.0)
    cover *= np.minimum(1.0, LINE_WIDTH_M / footprint)
    line = cover.max(axis=-1, keepdims=True)
    colours: Float64Array = (1 - line) * np.array(_FLOOR) + line * np.array(_LINE)
    return colours
