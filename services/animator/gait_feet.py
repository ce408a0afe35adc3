"""Feet over time: planted in stance, rolling over heel and ball, clear of the floor in swing."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from services.animator.gait_math import Array, clip, ease, hermite, mat_mul, mat_vec, rot_x, wrap
from services.animator.gait_person import GaitSkeleton
from services.animator.gait_steps import A_IN, A_OUT, ASIDE_X, ASIDE_Z, BUMP, OFF, ON, ROLL, SLOPE, STANCE, YAW, X, Y, Z

HEEL_STRIKE_RAD = math.radians(22.0)
TOE_OFF_RAD = math.radians(53.0)
# Shares of a stance that the sole needs to come down, and that the heel is off the floor.
ROLL_ON = 0.15
ROLL_OFF = 0.39
CLEARANCE_M = 0.022
TOE_RELEASE = 0.55
"""Share of the swing in which the toes, bent back at toe-off, straighten."""

# Pitch of the swinging foot after lift-off: share of the swing, pitch [rad] of a 1.2 m/s step, slope per swing;
# read off the foot angle of CMU mocap 02_01 and 02_02.
SWING_KEYS = np.array(
    [
        [0.14, math.radians(69.0), 0.0],
        [0.40, math.radians(43.0), math.radians(-120.0)],
        [0.66, math.radians(6.0), math.radians(-135.0)],
        [0.82, math.radians(-14.0), math.radians(-110.0)],
    ]
)
# Accelerations of the ankle at both ends of a swing, in ways per squared swing; mocap hardly slows before the strike.
SWING_START_ACCEL = 4.0
SWING_END_ACCEL = -4.4


@njit(cache=True)
def flat_frame(yaw_rad: float, slope: float, roll: float) -> Array:
    """Rotation of a sole that lies on a plane: x left, y up, z forward along the foot."""
    s, c = math.sin(yaw_rad), math.cos(yaw_rad)
    zx, zy, zz = s, slope, c
    xx, xy, xz = c, roll, -s
    yx, yy, yz = zy * xz - zz * xy, zz * xx - zx * xz, zx * xy - zy * xx
    n = math.sqrt(yx * yx + yy * yy + yz * yz)
    yx, yy, yz = yx / n, yy / n, yz / n
    n = math.sqrt(zx * zx + zy * zy + zz * zz)
    zx, zy, zz = zx / n, zy / n, zz / n
    F = np.empty((3, 3))
    F[0, 0], F[1, 0], F[2, 0] = yy * zz - yz * zy, yz * zx - yx * zz, yx * zy - yy * zx
    F[0, 1], F[1, 1], F[2, 1] = yx, yy, yz
    F[0, 2], F[1, 2], F[2, 2] = zx, zy, zz
    return F


@njit(cache=True)
def _pivot(contact: Array, F: Array, R: Array, point: Array, out: Array) -> None:
    """Ankle of a foot that turned from `F` to `R` about a point fixed on the floor."""
    before, after = mat_vec(F, point), mat_vec(R, point)
    out[0] = contact[X] + before[0] - after[0]
    out[1] = contact[Y] + before[1] - after[1]
    out[2] = contact[Z] + before[2] - after[2]


@njit(cache=True)
def _stance(
    contact: Array, time_s: float, skeleton: GaitSkeleton, joint: int, ankle: Array, R_foot: Array, R_toe: Array
) -> None:
    """Pose of a foot on the floor: heel strike, flat, or heel off with the toes flat."""
    F = flat_frame(contact[YAW], contact[SLOPE], contact[ROLL])
    on = (time_s - contact[ON]) / (ROLL_ON * contact[STANCE])
    off = 1.0 - (contact[OFF] - time_s) / (ROLL_OFF * contact[STANCE])
    if on < 1.0 and off <= 0.0:
        pitch = -HEEL_STRIKE_RAD * contact[A_IN] * (1.0 - on * on * (3.0 - 2.0 * on))
        R = mat_mul(F, rot_x(pitch))
        _pivot(contact, F, R, np.array([0.0, -skeleton.sole_m, -skeleton.heel_m]), ankle)
        R_foot[:], R_toe[:] = R, R
    elif off > 0.0:
        pitch = TOE_OFF_RAD * contact[A_OUT] * off * off
        R = mat_mul(F, rot_x(pitch))
        _pivot(contact, F, R, skeleton.offsets_m[joint], ankle)
        R_foot[:], R_toe[:] = R, F
    else:
        ankle[0], ankle[1], ankle[2] = contact[X], contact[Y], contact[Z]
        R_foot[:], R_toe[:] = F, F


@njit(cache=True)
def _swing_pitch(x: float, a: Array, b: Array, swing_s: float) -> float:
    """Pitch of the foot at share `x` of a swing; smooth across lift-off and touch-down."""
    start, end = TOE_OFF_RAD * a[A_OUT], -HEEL_STRIKE_RAD * b[A_IN]
    x0, y0, d0 = 0.0, start, 2.0 * start * swing_s / (ROLL_OFF * a[STANCE])
    for k in range(len(SWING_KEYS)):
        size = a[A_OUT] if k < 2 else b[A_IN]
        x1, y1, d1 = SWING_KEYS[k, 0], SWING_KEYS[k, 1] * size, SWING_KEYS[k, 2] * size
        if x <= x1:
            return hermite(x, x0, y0, d0, x1, y1, d1)
        x0, y0, d0 = x1, y1, d1
    return hermite(x, x0, y0, d0, 1.0, end, 0.0)


@njit(cache=True)
def _height_needed(
    F: Array, R_foot: Array, R_toe: Array, skeleton: GaitSkeleton, joint: int, softness_m: float
) -> float:
    """Height at which the ankle must be for the lowest point of the sole to touch a plane through the origin.

    `F` is the frame of a sole that lies on the plane; a soft maximum over heel, ball and toe tip if `softness_m` > 0.
    """
    ball = mat_vec(R_foot, skeleton.offsets_m[joint])
    beyond = skeleton.toe_m - skeleton.offsets_m[joint, 2]
    heel = mat_vec(R_foot, np.array([0.0, -skeleton.sole_m, -skeleton.heel_m]))
    under = ball + mat_vec(R_toe, np.array([0.0, -skeleton.toe_sole_m, 0.0]))
    tip = ball + mat_vec(R_toe, np.array([0.0, -skeleton.toe_sole_m, beyond]))
    nx, ny, nz = F[0, 1], F[1, 1], F[2, 1]
    h0 = -(heel[0] * nx + heel[1] * ny + heel[2] * nz) / ny
    h1 = -(under[0] * nx + under[1] * ny + under[2] * nz) / ny
    h2 = -(tip[0] * nx + tip[1] * ny + tip[2] * nz) / ny
    top: float = max(h0, h1, h2)
    if softness_m <= 1e-6:
        return top
    total: float = (
        math.exp((h0 - top) / softness_m) + math.exp((h1 - top) / softness_m) + math.exp((h2 - top) / softness_m)
    )
    return top + softness_m * math.log(total)


@njit(cache=True)
def _swing_way(x: float) -> float:
    """Share of the way covered at share `x` of the swing, from rest to rest with the accelerations above (quintic)."""
    y = 1.0 - x
    return ease(x) + 0.5 * x * x * y * y * (SWING_START_ACCEL * y + SWING_END_ACCEL * x)


@njit(cache=True)
def _ends_of_swing(a: Array, b: Array, skeleton: GaitSkeleton, joint: int) -> Array:
    """Ankle and height of the floor's plane below it, at lift-off from `a` and at touch-down on `b`, shape (2, 4)."""
    ends = np.empty((2, 4))
    R_foot, R_toe = np.empty((3, 3)), np.empty((3, 3))
    for n in range(2):
        contact, time_s = (a, a[OFF]) if n == 0 else (b, b[ON])
        _stance(contact, time_s, skeleton, joint, ends[n], R_foot, R_toe)
        F = flat_frame(contact[YAW], contact[SLOPE], contact[ROLL])
        ends[n, 3] = ends[n, 1] - _height_needed(F, R_foot, R_toe, skeleton, joint, 0.0)
    return ends


@njit(cache=True)
def _push_off(a: Array, skeleton: GaitSkeleton, joint: int) -> float:
    """Forward speed [m/s] that rolling over the ball gives the ankle at lift-off."""
    ball = skeleton.offsets_m[joint]
    theta = TOE_OFF_RAD * a[A_OUT]
    arm_m = ball[2] * math.sin(theta) - ball[1] * math.cos(theta)
    speed_mps: float = arm_m * 2.0 * theta / (ROLL_OFF * a[STANCE])
    return speed_mps


@njit(cache=True)
def _lift(x: float, a: Array, b: Array, size: float) -> float:
    """Clearance of the sole [m] at share `x` of a swing."""
    # The sole leaves and meets the floor steeply, so that it does not sweep along it.
    lift = 1.0 - (1.0 - x / 0.35) ** 3 if x < 0.35 else 1.0 - ((x - 0.35) / 0.65) ** 5
    reach = clip(0.5 + 0.5 * max(a[A_OUT], b[A_IN]), 0.0, 1.0)
    height: float = CLEARANCE_M * size * reach * lift + a[BUMP] * ease(3.0 * x) * ease(3.0 * (1.0 - x))
    return height


@njit(cache=True)
def _swing(
    a: Array, b: Array, time_s: float, skeleton: GaitSkeleton, joint: int, ankle: Array, R_foot: Array, R_toe: Array
) -> None:
    """Pose of a foot between contact `a` and contact `b`."""
    swing_s = b[ON] - a[OFF]
    x = clip((time_s - a[OFF]) / swing_s, 0.0, 1.0)
    u, w = ease(x), _swing_way(x)
    yaw = a[YAW] + u * wrap(b[YAW] - a[YAW])
    F = flat_frame(yaw, a[SLOPE] + u * (b[SLOPE] - a[SLOPE]), a[ROLL] + u * (b[ROLL] - a[ROLL]))
    pitch = _swing_pitch(x, a, b, swing_s)
    bent = clip(x / TOE_RELEASE, 0.0, 1.0)
    R_foot[:] = mat_mul(F, rot_x(pitch))
    R_toe[:] = mat_mul(F, rot_x(pitch - TOE_OFF_RAD * a[A_OUT] * (1.0 - bent * bent * (3.0 - 2.0 * bent))))
    ends = _ends_of_swing(a, b, skeleton, joint)
    dx, dz = ends[1, 0] - ends[0, 0], ends[1, 2] - ends[0, 2]
    # The ankle leaves with the speed of the roll over the ball, and bends aside around the body's curve.
    push = min(_push_off(a, skeleton, joint) * swing_s, 0.9 * math.sqrt(dx * dx + dz * dz))
    push *= x * (1.0 + x * x * (-6.0 + x * (8.0 - 3.0 * x)))
    bend = 16.0 * (x * (1.0 - x)) ** 2
    off_x = push * math.sin(a[YAW]) + bend * a[ASIDE_X]
    off_z = push * math.cos(a[YAW]) + bend * a[ASIDE_Z]
    ankle[0], ankle[2] = ends[0, 0] + w * dx + off_x, ends[0, 2] + w * dz + off_z
    plane_m = ends[0, 3] + w * (ends[1, 3] - ends[0, 3]) - (off_x * F[0, 1] + off_z * F[2, 1]) / F[1, 1]
    softness_m = 0.010 * ease(4.0 * x) * ease(4.0 * (1.0 - x))
    needed_m = _height_needed(F, R_foot, R_toe, skeleton, joint, softness_m)
    ankle[1] = plane_m + needed_m + _lift(x, a, b, skeleton.size)


class Feet(NamedTuple):
    """Both feet over time; index 0 left, 1 right."""

    ankle_m: Array
    """Ankles in the y-up world [m], shape (2, T, 3)."""
    R_foot: Array
    """Global rotations of the feet, shape (2, T, 3, 3)."""
    R_toe: Array
    """Global rotations of the toes, shape (2, T, 3, 3)."""


@njit(cache=True)
def pose_foot(contacts: Array, foot: int, skeleton: GaitSkeleton, times_s: Array, feet: Feet) -> None:
    """Fill in one foot's poses.

    Args:
        contacts: The foot's contacts, see `plan_contacts`.
        foot: 0 left, 1 right.
        skeleton: Measures of the body.
        times_s: Increasing times [s], shape (T,).
        feet: Takes the result.
    """
    k = 0
    for i in range(len(times_s)):
        t = times_s[i]
        ankle, R_foot, R_toe = feet.ankle_m[foot, i], feet.R_foot[foot, i], feet.R_toe[foot, i]
        while k + 1 < len(contacts) and contacts[k + 1, ON] <= t:
            k += 1
        if t <= contacts[k, OFF] or k + 1 == len(contacts):
            _stance(contacts[k], t, skeleton, 10 + foot, ankle, R_foot, R_toe)
        else:
            _swing(contacts[k], contacts[k + 1], t, skeleton, 10 + foot, ankle, R_foot, R_toe)
