"""Feet over time: planted in stance, rolling over heel and ball, clear of the floor in swing."""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.kernels import kernel_with_cache
from readygo.services.animator.gait.curves import Curves, curve_at, weights_of
from readygo.services.animator.gait.human import GaitSkeleton
from readygo.services.animator.gait.math import clip, ease, mat_mul, mat_vec, rot_x, soft_max, wrap
from readygo.services.animator.gait.steps import (
    A_IN,
    A_OUT,
    ASIDE_X,
    ASIDE_Z,
    BUMP,
    OFF,
    ON,
    ROLL,
    RUN,
    SLOPE,
    SPEED,
    STANCE,
    YAW,
    X,
    Y,
    Z,
)

CLEARANCE_M = 0.022
TOE_RELEASE = 0.55
"""Share of the swing in which the toes, bent back at toe-off, straighten."""
TOE_HOLD = 0.4
"""1: the toes keep the bend of toe-off; 0: they keep to the floor while the foot pitches on."""
SOFTNESS_M = 0.010
END_SHARE = 0.02
"""Share of a stance or swing over which slopes at its ends are taken."""


@kernel_with_cache
def flat_frame(yaw_rad: float, slope: float, roll: float) -> Float64Array:
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


@kernel_with_cache
def _pivot(contact: Float64Array, F: Float64Array, R: Float64Array, point: Float64Array, out: Float64Array) -> None:
    """Ankle of a foot that turned from `F` to `R` about a point fixed on the floor."""
    before, after = mat_vec(F, point), mat_vec(R, point)
    out[0] = contact[X] + before[0] - after[0]
    out[1] = contact[Y] + before[1] - after[1]
    out[2] = contact[Z] + before[2] - after[2]


@kernel_with_cache
def _weights(contact: Float64Array, curves: Curves) -> Float64Array:
    return weights_of(curves, contact[SPEED], contact[RUN])


@kernel_with_cache
def _stance(
    contact: Float64Array,
    time_s: float,
    skeleton: GaitSkeleton,
    curves: Curves,
    joint: int,
    ankle: Float64Array,
    R_foot: Float64Array,
    R_toe: Float64Array,
) -> None:
    """Pose of a foot on the floor: heel strike, flat, or heel off with the toes flat."""
    F = flat_frame(contact[YAW], contact[SLOPE], contact[ROLL])
    weights, table = _weights(contact, curves), curves.stance_pitch
    since, until = (time_s - contact[ON]) / contact[STANCE], (contact[OFF] - time_s) / contact[STANCE]
    heel = contact[A_IN] * min(curve_at(table, weights, since), 0.0) if since < 0.5 else 0.0
    toes = contact[A_OUT] * max(curve_at(table, weights, 1.0 - until), 0.0) if until < 0.75 else 0.0
    R = mat_mul(F, rot_x(heel + toes))
    R_foot[:] = R
    if heel + toes < 0.0:
        _pivot(contact, F, R, np.array([0.0, -skeleton.sole_m, -skeleton.heel_m]), ankle)
        R_toe[:] = R
    else:
        _pivot(contact, F, R, skeleton.offsets_m[joint], ankle)
        R_toe[:] = F


@kernel_with_cache
def _swing_pitch(x: float, a: Float64Array, b: Float64Array, curves: Curves) -> float:
    """Pitch of the foot at share `x` of a swing, the one of the stances at its ends."""
    table, later = curves.swing_pitch, ease(x)
    start, end = curve_at(table, _weights(a, curves), x), curve_at(table, _weights(b, curves), x)
    pitch_rad: float = (1.0 - later) * a[A_OUT] * start + later * b[A_IN] * end
    return pitch_rad


@kernel_with_cache
def _height_needed(
    F: Float64Array, R_foot: Float64Array, R_toe: Float64Array, skeleton: GaitSkeleton, joint: int, softness_m: float
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


@kernel_with_cache
def _ends_of_swing(
    a: Float64Array, b: Float64Array, skeleton: GaitSkeleton, curves: Curves, joint: int
) -> Float64Array:
    """Where a swing begins and ends, shape (2, 5): ankle, height of the floor's plane and of the ankle above it."""
    ends = np.empty((2, 5))
    R_foot, R_toe = np.empty((3, 3)), np.empty((3, 3))
    for n in range(2):
        contact, time_s = (a, a[OFF]) if n == 0 else (b, b[ON])
        _stance(contact, time_s, skeleton, curves, joint, ends[n], R_foot, R_toe)
        F = flat_frame(contact[YAW], contact[SLOPE], contact[ROLL])
        ends[n, 4] = _height_needed(F, R_foot, R_toe, skeleton, joint, 0.0)
        ends[n, 3] = ends[n, 1] - ends[n, 4]
    return ends


@kernel_with_cache
def _roll_speed(contact: Float64Array, skeleton: GaitSkeleton, curves: Curves, joint: int, leaving: bool) -> float:
    """Forward speed [m/s] of the ankle while the foot rolls over its heel at touch-down, or its ball at lift-off."""
    weights, table, duration = _weights(contact, curves), curves.stance_pitch, END_SHARE * contact[STANCE]
    if leaving:
        up, ahead = -skeleton.offsets_m[joint, 1], skeleton.offsets_m[joint, 2]
        pitch = contact[A_OUT] * curve_at(table, weights, 1.0)
        rate = (pitch - contact[A_OUT] * curve_at(table, weights, 1.0 - END_SHARE)) / duration
    else:
        up, ahead = skeleton.sole_m, -skeleton.heel_m
        pitch = contact[A_IN] * curve_at(table, weights, 0.0)
        rate = (contact[A_IN] * curve_at(table, weights, END_SHARE) - pitch) / duration
    speed_mps: float = (up * math.cos(pitch) + ahead * math.sin(pitch)) * rate
    return speed_mps


@kernel_with_cache
def _clearance(x: float, a: Float64Array, b: Float64Array, size: float) -> float:
    """Least height of the sole above the floor [m] at share `x` of a swing."""
    # The sole leaves and meets the floor steeply, so that it does not sweep along it.
    lift = 1.0 - (1.0 - x / 0.3) ** 5 if x < 0.3 else 1.0 - ((x - 0.3) / 0.7) ** 8
    reach = clip(0.5 + 0.5 * max(a[A_OUT], b[A_IN]), 0.0, 1.0)
    height: float = CLEARANCE_M * size * reach * lift
    return height


@kernel_with_cache
def _ankle_height(
    x: float, a: Float64Array, b: Float64Array, ends: Float64Array, skeleton: GaitSkeleton, curves: Curves
) -> float:
    """Height of the ankle above the floor [m] at share `x` of a swing, as in the mocap but for its ends."""
    later, table = ease(x), curves.swing_up
    start, end = a[A_OUT] * skeleton.leg_m, b[A_IN] * skeleton.leg_m
    weights_a, weights_b = _weights(a, curves), _weights(b, curves)
    up = (1.0 - later) * start * curve_at(table, weights_a, x) + later * end * curve_at(table, weights_b, x)
    early, late = clip(1.0 - x / 0.6, 0.0, 1.0), clip(1.0 - (1.0 - x) / 0.5, 0.0, 1.0)
    up += early * early * (ends[0, 4] - skeleton.sole_m - start * curve_at(table, weights_a, 0.0))
    up += late * late * (ends[1, 4] - skeleton.sole_m - end * curve_at(table, weights_b, 1.0))
    height_m: float = skeleton.sole_m + up
    return height_m


@kernel_with_cache
def _way(x: float, a: Float64Array, b: Float64Array, curves: Curves) -> float:
    """Share of the way covered at share `x` of a swing."""
    later, table = ease(x), curves.swing_way
    start, end = curve_at(table, _weights(a, curves), x), curve_at(table, _weights(b, curves), x)
    return (1.0 - later) * start + later * end


@kernel_with_cache
def _swing(
    a: Float64Array,
    b: Float64Array,
    time_s: float,
    skeleton: GaitSkeleton,
    curves: Curves,
    joint: int,
    ankle: Float64Array,
    R_foot: Float64Array,
    R_toe: Float64Array,
) -> None:
    """Pose of a foot between contact `a` and contact `b`."""
    swing_s = b[ON] - a[OFF]
    x = clip((time_s - a[OFF]) / swing_s, 0.0, 1.0)
    u, w = ease(x), _way(x, a, b, curves)
    yaw = a[YAW] + u * wrap(b[YAW] - a[YAW])
    F = flat_frame(yaw, a[SLOPE] + u * (b[SLOPE] - a[SLOPE]), a[ROLL] + u * (b[ROLL] - a[ROLL]))
    pitch, bent = _swing_pitch(x, a, b, curves), clip(x / TOE_RELEASE, 0.0, 1.0)
    R_foot[:] = mat_mul(F, rot_x(pitch))
    # Toes stay bent back as at toe-off, a little more while the foot still pitches down, and straighten.
    toe_bend = pitch + TOE_HOLD * (_swing_pitch(0.0, a, b, curves) - pitch)
    R_toe[:] = mat_mul(F, rot_x(pitch - toe_bend * (1.0 - bent * bent * (3.0 - 2.0 * bent))))
    ends = _ends_of_swing(a, b, skeleton, curves, joint)
    dx, dz = ends[1, 0] - ends[0, 0], ends[1, 2] - ends[0, 2]
    # The ankle leaves and arrives with the speed of the foot's roll, and bends aside around the body's curve.
    leave_m = _roll_speed(a, skeleton, curves, joint, True) * swing_s
    arrive_m = _roll_speed(b, skeleton, curves, joint, False) * swing_s
    leaving, arriving = x * (1.0 - x) ** 4, -(1.0 - x) * x**5
    slope_a, slope_b = (
        _way(END_SHARE, a, b, curves) / END_SHARE,
        (1.0 - _way(1.0 - END_SHARE, a, b, curves)) / END_SHARE,
    )
    bend = 16.0 * (x * (1.0 - x)) ** 2
    off_x = leaving * (leave_m * math.sin(a[YAW]) - slope_a * dx) + bend * a[ASIDE_X]
    off_z = leaving * (leave_m * math.cos(a[YAW]) - slope_a * dz) + bend * a[ASIDE_Z]
    off_x += arriving * (arrive_m * math.sin(b[YAW]) - slope_b * dx)
    off_z += arriving * (arrive_m * math.cos(b[YAW]) - slope_b * dz)
    ankle[0], ankle[2] = ends[0, 0] + w * dx + off_x, ends[0, 2] + w * dz + off_z
    plane_m = ends[0, 3] + w * (ends[1, 3] - ends[0, 3]) - (off_x * F[0, 1] + off_z * F[2, 1]) / F[1, 1]
    inside = ease(4.0 * x) * ease(4.0 * (1.0 - x))
    needed_m = _height_needed(F, R_foot, R_toe, skeleton, joint, SOFTNESS_M * inside)
    needed_m += _clearance(x, a, b, skeleton.size)
    raised_m = _ankle_height(x, a, b, ends, skeleton, curves)
    bump_m = a[BUMP] * ease(3.0 * x) * ease(3.0 * (1.0 - x))
    ankle[1] = plane_m + soft_max(needed_m, raised_m, SOFTNESS_M * inside) + bump_m


class Feet(NamedTuple):
    """Both feet over time; index 0 left, 1 right."""

    ankle_m: Float64Array
    """Ankles in the y-up world [m], shape (2, T, 3)."""
    R_foot: Float64Array
    """Global rotations of the feet, shape (2, T, 3, 3)."""
    R_toe: Float64Array
    """Global rotations of the toes, shape (2, T, 3, 3)."""


@kernel_with_cache
def pose_foot(
    contacts: Float64Array, foot: int, skeleton: GaitSkeleton, curves: Curves, times_s: Float64Array, feet: Feet
) -> None:
    """Fill in one foot's poses.

    Args:
        contacts: The foot's contacts, see `plan_contacts`.
        foot: 0 left, 1 right.
        skeleton: Measures of the body.
        curves: How people walk.
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
            _stance(contacts[k], t, skeleton, curves, 10 + foot, ankle, R_foot, R_toe)
        else:
            _swing(contacts[k], contacts[k + 1], t, skeleton, curves, 10 + foot, ankle, R_foot, R_toe)
