"""Frames, rotations and rigid transforms; the conventions are in ARCHITECTURE.md."""

from readygo.common.frames.robot_frame import goal_in_robot_frame, goals_in_robot_frames
from readygo.common.frames.rotations import (
    axis_angle_from_matrix,
    matrix_from_axis_angle,
    matrix_from_quat,
    quat_from_matrix,
    quat_multiply,
    wrap_angle,
)
from readygo.common.frames.up_axis import swap_opengl_axes, yup_from_zup, zup_from_yup

__all__ = [
    "axis_angle_from_matrix",
    "goal_in_robot_frame",
    "goals_in_robot_frames",
    "matrix_from_axis_angle",
    "matrix_from_quat",
    "quat_from_matrix",
    "quat_multiply",
    "swap_opengl_axes",
    "wrap_angle",
    "yup_from_zup",
    "zup_from_yup",
]
