"""A sheet of an avatar from all sides, in a pose."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from readygo.apps.avatar.studio import Framing, Studio, look_at
from readygo.common.avatars import Avatar, joint_positions
from readygo.common.frames import axis_angle_from_matrix, matrix_from_axis_angle
from readygo.common.messages import Motion

FloatArray = npt.NDArray[np.float32]
Image = npt.NDArray[np.uint8]

VIEW_COUNT = 8
FRAMING = Framing(height_px=420, width_px=240, focal_px=830.0)
CAMERA_DISTANCE_M, CAMERA_HEIGHT_M = 4.2, 1.2


def turntable(avatar: Avatar, poses: Sequence[FloatArray]) -> Image:
    """A sheet with a row of views per pose, the person turning left from image to image.

    Args:
        avatar: Avatar to draw.
        poses: Joint rotations [rad] as in `Motion` for a person that faces SMPL's +z, shape (24, 3) each.

    Returns:
        RGB, shape (len(poses) * 420, 8 * 240, 3).
    """
    studio = Studio(avatar, FRAMING)
    # In front of the person, who faces -y, looking at the middle of the body.
    camera = look_at((0.0, -CAMERA_DISTANCE_M, CAMERA_HEIGHT_M), (0.0, 0.0, 0.52 * avatar.height_m))
    rows = []
    for pose in poses:
        tiles = []
        for view in range(VIEW_COUNT):
            turned = _turned(pose, 2 * np.pi * view / VIEW_COUNT)
            motion = Motion(root_m=_grounded_root(avatar, turned)[None], pose_axis_angle=turned[None])
            tiles.append(studio.picture(camera, motion, 0, joint_positions(avatar, motion)))
        rows.append(np.concatenate(tiles, axis=1))
    return np.concatenate(rows)


def standing_pose() -> FloatArray:
    """Joint rotations of standing upright, arms down [rad], shape (24, 3)."""
    pose = np.zeros((24, 3), dtype=np.float32)
    pose[16] = (0.0, -0.15, -1.22)
    pose[17] = (0.0, 0.15, 1.22)
    pose[18], pose[19] = (0.0, -0.25, 0.0), (0.0, 0.25, 0.0)
    return pose


def stride_pose() -> FloatArray:
    """Joint rotations of mid-stride, left foot and right arm ahead [rad], shape (24, 3)."""
    pose = standing_pose()
    pose[1], pose[2] = (-0.42, 0.0, 0.0), (0.30, 0.0, 0.0)
    pose[4], pose[5] = (0.10, 0.0, 0.0), (0.45, 0.0, 0.0)
    pose[8] = (0.25, 0.0, 0.0)
    pose[16], pose[17] = _after(pose[16], 0.35), _after(pose[17], -0.40)
    return pose


def _after(axis_angle: FloatArray, swing_rad: float) -> FloatArray:
    """A rotation followed by one about the axis to the body's left."""
    R = matrix_from_axis_angle((swing_rad, 0.0, 0.0)) @ matrix_from_axis_angle(axis_angle)
    return axis_angle_from_matrix(R).astype(np.float32)


def _turned(pose: FloatArray, angle_rad: float) -> FloatArray:
    turned = pose.copy()
    R = matrix_from_axis_angle((0.0, angle_rad, 0.0)) @ matrix_from_axis_angle(pose[0])
    turned[0] = axis_angle_from_matrix(R)
    return turned


def _grounded_root(avatar: Avatar, pose: FloatArray) -> FloatArray:
    """Pelvis position that puts the lower ankle at its height when the person stands on z = 0."""
    motion = Motion(root_m=np.zeros((1, 3), dtype=np.float32), pose_axis_angle=pose[None])
    ankles_m = joint_positions(avatar, motion)[0, [7, 8], 2]
    return np.array([0.0, 0.0, avatar.joints_tpose_m[7, 1] - ankles_m.min()], dtype=np.float32)
