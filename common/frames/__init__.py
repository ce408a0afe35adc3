"""Frames, rotations and rigid transforms; the conventions are in ARCHITECTURE.md."""

from readygo.common.frames.rotations import (
    R_zup_yup,
    axis_angle_from_matrix,
    matrix_from_axis_angle,
    matrix_from_quat,
    quat_from_matrix,
    quat_multiply,
    wrap_angle,
)

__all__ = [
    "R_zup_yup",
    "axis_angle_from_matrix",
    "matrix_from_axis_angle",
    "matrix_from_quat",
    "quat_from_matrix",
    "quat_multiply",
    "wrap_angle",
]
