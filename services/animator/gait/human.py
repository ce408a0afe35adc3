"""Measures of a walking human's skeleton and habits of the person."""

from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars import SMPL_PARENTS, Avatar
from readygo.common.errors import AvatarError

# Heel and toe tip of a shoe, as multiples of the distance from the ankle to the ball of the foot; measured on a shod
# 1.74 m body: heel 0.079 m behind the ankle, ball 0.156 m and toe tip 0.215 m ahead of it.
HEEL_PER_BALL = 0.50
TOE_PER_BALL = 1.38
REFERENCE_LEG_M = 0.80


class GaitSkeleton(NamedTuple):
    """Measures [m] of a body in SMPL's T-pose (y up, x left, z forward)."""

    offsets_m: Float64Array
    """Each joint relative to its parent, shape (24, 3); row 0 is zero."""
    leg_m: float
    """Thigh and shin together."""
    sole_m: float
    """Height of the ankle above the sole [m]."""
    toe_sole_m: float
    """Joint at the ball of the foot above the sole."""
    heel_m: float
    """Back end of the sole behind the ankle."""
    toe_m: float
    """Front end of the sole ahead of the ankle."""
    size: float
    """Leg length relative to the 0.80 m of the people that the statistics come from."""


class GaitStyle(NamedTuple):
    """Habits of one person; all are small departures from the average walk."""

    cadence: float
    """Factor on the step rate (the step length changes the other way)."""
    arm_swing: float
    """Factor on the arms' swing."""
    arm_asymmetry: float
    """Share by which the left arm swings more than the right."""
    arm_abduction_rad: float
    elbow_rad: float
    """Added elbow bend."""
    lean_rad: float
    """Added forward lean of the trunk."""
    step_half_width_m: float
    """Half the lateral distance of the ankles while walking."""
    toe_out_rad: float
    pelvis_turn: float
    """Factor on pelvis yaw and list."""
    bounce: float
    """Factor on the pelvis' vertical oscillation."""
    head_pitch_rad: float
    idle_phase_rad: float
    """Phase at which the idle sway begins [rad]."""
    lead_left: float
    """Below 0.5: the left foot makes the first step of a straight start."""
    stride_offset: float
    """Strides walked before the first row of a motion that begins in mid-gait, 0..1."""
    heading_rad: float
    """Heading of a person who never moves."""


def skeleton_of(avatar: Avatar) -> GaitSkeleton:
    """Measures of an avatar's skeleton.

    Raises:
        AvatarError: If legs or feet have measures that no standing person has.
    """
    joints = avatar.joints_tpose_m.astype(np.float64)
    offsets = np.zeros((24, 3))
    offsets[1:] = joints[1:] - joints[SMPL_PARENTS[1:]]
    lengths = np.sqrt((offsets * offsets)[:, 0] + (offsets * offsets)[:, 1] + (offsets * offsets)[:, 2])
    leg = 0.5 * float(lengths[4] + lengths[7] + lengths[5] + lengths[8])
    ankle = avatar.joints_canonical_m.astype(np.float64)[7:9, 1]
    sole = 0.5 * float(ankle[0] + ankle[1])
    drop = -0.5 * float(offsets[10, 1] + offsets[11, 1])
    ball = 0.5 * float(offsets[10, 2] + offsets[11, 2])
    if not 0.3 <= leg <= 1.5 or not 0.03 <= sole <= 0.25 or not 0.04 <= ball <= 0.35 or not 0.0 <= drop < sole:
        raise AvatarError(
            f"Avatar {avatar.name!r} cannot walk: legs {leg:.2f} m, ankles {sole:.3f} m above the soles, balls of the "
            f"feet {ball:.3f} m ahead and {drop:.3f} m below them; soles must be at y = 0 in the canonical pose."
        )
    return GaitSkeleton(
        offsets, leg, sole, sole - drop, HEEL_PER_BALL * ball, TOE_PER_BALL * ball, leg / REFERENCE_LEG_M
    )


def draw_style(rng: np.random.Generator, variation: float, size: float) -> GaitStyle:
    """Habits of a person.

    Args:
        rng: Source of chance; the number of drawn values does not depend on `variation`.
        variation: 0 (the average person) to 1.
        size: Leg length relative to the reference, scales lengths.
    """
    n = np.clip(rng.standard_normal(12), -2.0, 2.0) * variation
    u = rng.random(4)
    return GaitStyle(
        cadence=float(1.0 + 0.02 * n[0]),
        arm_swing=float(1.0 + 0.14 * n[1]),
        arm_asymmetry=float(0.08 * n[2]),
        arm_abduction_rad=float(0.17 + 0.02 * n[3]),
        elbow_rad=float(0.06 * n[4]),
        lean_rad=float(0.015 * n[5]),
        step_half_width_m=float((0.058 + 0.006 * n[6]) * size),
        toe_out_rad=float(0.12 + 0.04 * n[7]),
        pelvis_turn=float(1.0 + 0.12 * n[8]),
        bounce=float(1.0 + 0.06 * n[9]),
        head_pitch_rad=float(0.02 + 0.025 * n[10]),
        idle_phase_rad=float(2.0 * np.pi * u[0]),
        lead_left=float(u[1]),
        stride_offset=float(u[2]),
        heading_rad=float(2.0 * np.pi * u[3]),
    )
