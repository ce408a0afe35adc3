"""Footsteps: where and when each foot stands, on the path's sides and on the local floor."""

import math

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot.kinematics import DT_S
from readygo.services.animator.gait.curves import Curves, mix_clips, weights_of
from readygo.services.animator.gait.human import GaitSkeleton, GaitStyle
from readygo.services.animator.gait.math import Ground, clip, floor_at, sample, wrap
from readygo.services.animator.gait.path import GaitTrack, time_of_phase

# Columns of a foot's contacts, shape (C, 16).
ON, OFF = 0, 1
"""Times of touch-down and lift-off [s]."""
X, Y, Z = 2, 3, 4
"""Ankle while the sole lies flat, y-up world [m]."""
YAW, SLOPE, ROLL = 5, 6, 7
"""Heading of the foot [rad] and the floor's rise per metre forward and to the left."""
STANCE = 8
"""Duration of a stance at this pace [s], which times the heel-strike and the heel-off."""
A_IN, A_OUT = 9, 10
"""How far the foot reaches ahead at touch-down and is left behind at lift-off, 1 as in the mocap: scales its roll."""
BUMP = 11
"""How far the floor rises above the straight way to the next contact [m]."""
ASIDE_X, ASIDE_Z = 12, 13
"""How far the way to the next contact bends aside in its middle, around the body's curve [m]."""

SPEED, RUN = 14, 15
"""Speed at touch-down [m/s] (of legs of 0.80 m) and share of running: which curves the foot follows."""

STAND_HALF_WIDTH_M = 0.088
"""Half the distance of the ankles of someone who stands, legs of 0.80 m."""
STAND_BACK_M = 0.03
EDGE_RISE_M = 0.09
"""A floor that rises more than this below one sole is an edge: the foot stands level on its upper side."""
REACH_MAX = 1.05
RUN_NARROWING = 0.6
"""Share by which runners' feet are closer to the line than walkers'."""


@kernel_with_cache
def duty(curves: Curves, weights: Float64Array, speed: float) -> float:
    """Share of the stride that a foot is on the floor; beyond the clips' speeds slower people stand longer."""
    slowest, fastest = curves.speed[0], curves.speed[curves.walks - 1]
    walking = 0.0
    for k in range(curves.walks):
        walking += weights[k]
    beyond = max(slowest - speed, 0.0) - clip(speed - fastest, 0.0, 0.6) * walking
    share: float = min(mix_clips(curves.duty, weights) + 0.05 * beyond, 0.68)
    return share


@kernel_with_cache
def _place(
    contact: Float64Array,
    track: GaitTrack,
    at_s: float,
    standing: bool,
    side: float,
    skeleton: GaitSkeleton,
    style: GaitStyle,
    ground: Ground,
) -> None:
    """Fill position and floor plane of a contact whose stance is centred on a time."""
    at = at_s / DT_S
    psi = sample(track.psi, at)
    pace = 0.0 if standing else clip(sample(track.pace, at) / 0.6, 0.0, 1.0)
    walking = style.step_half_width_m * (1.0 - RUN_NARROWING * sample(track.run, at))
    half = STAND_HALF_WIDTH_M * skeleton.size * (1.0 - pace) + walking * pace
    back = STAND_BACK_M * skeleton.size * (1.0 - 0.5 * pace)
    s, c = math.sin(psi), math.cos(psi)
    x = sample(track.x, at) + side * half * c - back * s
    z = sample(track.z, at) - side * half * s - back * c
    yaw = psi + side * style.toe_out_rad
    s, c = math.sin(yaw), math.cos(yaw)
    ball = skeleton.offsets_m[10, 2]
    heel_y = floor_at(ground, x - skeleton.heel_m * s, z - skeleton.heel_m * c)
    ball_y = floor_at(ground, x + ball * s, z + ball * c)
    middle = 0.5 * (ball - skeleton.heel_m)
    mx, mz = x + middle * s, z + middle * c
    left_y = floor_at(ground, mx + 0.04 * c, mz - 0.04 * s)
    right_y = floor_at(ground, mx - 0.04 * c, mz + 0.04 * s)
    contact[X], contact[Z], contact[YAW] = x, z, yaw
    tip_y = floor_at(ground, x + skeleton.toe_m * s, z + skeleton.toe_m * c)
    top, bottom = max(heel_y, ball_y, left_y, right_y, tip_y), min(heel_y, ball_y, left_y, right_y, tip_y)
    if top - bottom > EDGE_RISE_M:
        heel_y = top
        ball_y, left_y, right_y = heel_y, heel_y, heel_y
    contact[SLOPE] = clip((ball_y - heel_y) / (ball + skeleton.heel_m), -0.5, 0.5)
    contact[ROLL] = clip((left_y - right_y) / 0.08, -0.35, 0.35)
    up = math.sqrt(1.0 + contact[SLOPE] ** 2 + contact[ROLL] ** 2)
    share = skeleton.heel_m / (ball + skeleton.heel_m)
    contact[Y] = heel_y + share * (ball_y - heel_y) + skeleton.sole_m * up


@kernel_with_cache
def _same_place(a: Float64Array, b: Float64Array) -> bool:
    """True if a step from `a` to `b` would not be worth making."""
    apart = (a[X] - b[X]) ** 2 + (a[Z] - b[Z]) ** 2
    return apart < 0.025**2 and abs(wrap(a[YAW] - b[YAW])) < 0.1


@kernel_with_cache
def plan_contacts(
    track: GaitTrack,
    foot: int,
    skeleton: GaitSkeleton,
    style: GaitStyle,
    ground: Ground,
    curves: Curves,
) -> Float64Array:
    """Contacts of one foot over the whole track, from a stand to a stand.

    A contact lies beside the place that the pelvis passes at its middle; where that is after a bout's end, the foot
    comes to stand, so that every bout closes with the feet side by side.

    Args:
        track: Where the person goes.
        foot: 0 left, 1 right.
        skeleton: Measures of the body.
        style: Habits of the person.
        ground: The local floor.
        curves: How people walk.

    Returns:
        Contacts in order of time, shape (C, 16).
    """
    side = 1.0 if foot == 0 else -1.0
    capacity = int(2.2 * DT_S * len(track.x)) + 6 * len(track.bouts) + 4
    contacts = np.zeros((capacity, 16))
    _place(contacts[0], track, 0.0, True, side, skeleton, style, ground)
    contacts[0, ON], contacts[0, OFF], contacts[0, STANCE] = -1e9, 1e9, 0.6
    count = 1
    for bout in range(len(track.bouts)):
        end_s = track.bouts[bout, 1] * DT_S
        strike = 0.0 if foot == track.bouts[bout, 2] else 0.5
        standing = False
        while not standing and count < capacity:
            on_s = time_of_phase(track, bout, strike)
            speed = sample(track.pace, on_s / DT_S) / math.sqrt(skeleton.size)
            run = sample(track.run, on_s / DT_S)
            weights = weights_of(curves, speed, run)
            centre_s = time_of_phase(track, bout, strike + mix_clips(curves.mid, weights))
            standing = centre_s >= end_s
            share = duty(curves, weights, speed)
            off_s = max(time_of_phase(track, bout, strike - 1.0 + share), contacts[count - 1, ON] + 0.05, 0.0)
            _place(contacts[count], track, min(centre_s, end_s), standing, side, skeleton, style, ground)
            strike += 1.0
            if _same_place(contacts[count - 1], contacts[count]):
                continue
            contacts[count - 1, OFF] = off_s
            contacts[count, ON], contacts[count, OFF] = max(on_s, off_s + 0.2), 1e9
            contacts[count, SPEED], contacts[count, RUN] = speed, run
            contacts[count, STANCE] = share * max(time_of_phase(track, bout, strike) - on_s, 0.4)
            count += 1
    _link(contacts, count, track, side * 1.1 * style.step_half_width_m, skeleton, ground, curves)
    return contacts[:count].copy()


@kernel_with_cache
def _ahead(contact: Float64Array, track: GaitTrack, time_s: float) -> float:
    """How far a contact lies ahead of the pelvis at a time [m], in the direction of the foot."""
    dx, dz = contact[X] - sample(track.x, time_s / DT_S), contact[Z] - sample(track.z, time_s / DT_S)
    ahead_m: float = dx * math.sin(contact[YAW]) + dz * math.cos(contact[YAW])
    return ahead_m


@kernel_with_cache
def _bend_aside(a: Float64Array, b: Float64Array, track: GaitTrack, lateral_m: float) -> None:
    """Bend a swing so that the foot passes the body on its own side; on a curve the straight way would not."""
    at = 0.5 * (a[OFF] + b[ON]) / DT_S
    psi = sample(track.psi, at)
    left_x, left_z = math.cos(psi), -math.sin(psi)
    apart_x = sample(track.x, at) - 0.5 * (a[X] + b[X])
    apart_z = sample(track.z, at) - 0.5 * (a[Z] + b[Z])
    aside = clip(apart_x * left_x + apart_z * left_z + lateral_m, -0.2, 0.2)
    a[ASIDE_X], a[ASIDE_Z] = aside * left_x, aside * left_z


@kernel_with_cache
def _link(
    contacts: Float64Array,
    count: int,
    track: GaitTrack,
    lateral_m: float,
    skeleton: GaitSkeleton,
    ground: Ground,
    curves: Curves,
) -> None:
    """Reaches at touch-down and lift-off, and how far the floor bulges between contacts."""
    for k in range(count - 1):
        a, b = contacts[k], contacts[k + 1]
        dx, dz = b[X] - a[X], b[Z] - a[Z]
        trail_m = mix_clips(curves.trail, weights_of(curves, a[SPEED], a[RUN])) * skeleton.leg_m
        lead_m = mix_clips(curves.lead, weights_of(curves, b[SPEED], b[RUN])) * skeleton.leg_m
        a[A_OUT] = clip(-_ahead(a, track, a[OFF]) / trail_m, 0.12, REACH_MAX)
        b[A_IN] = clip(_ahead(b, track, b[ON]) / lead_m, 0.0, REACH_MAX)
        _bend_aside(a, b, track, lateral_m)
        bump = 0.0
        for n in range(1, 12):
            share = n / 12.0
            x, z = a[X] + share * dx, a[Z] + share * dz
            line = a[Y] + share * (b[Y] - a[Y]) - skeleton.sole_m
            yaw = a[YAW] + share * wrap(b[YAW] - a[YAW])
            for point in range(2):
                reach = skeleton.toe_m if point == 0 else -skeleton.heel_m
                rise = floor_at(ground, x + reach * math.sin(yaw), z + reach * math.cos(yaw)) - line
                bump = max(bump, rise - abs(a[SLOPE]) * skeleton.toe_m)
        a[BUMP] = clip(bump - 0.005, 0.0, 0.3)
