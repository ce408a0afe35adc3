"""The body above the feet: pelvis, legs by inverse kinematics, trunk, head and arms."""

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from common.avatars import SMPL_PARENTS
from services.animator.gait_feet import Feet
from services.animator.gait_math import (
    Array,
    Ground,
    axis_angle_of,
    clip,
    ease,
    floor_at,
    frame_of,
    mat_mul,
    mat_t_mul,
    mat_vec,
    norm,
    rot_x,
    rot_y,
    rot_z,
    sample,
    smooth,
    smooth_above,
)
from services.animator.gait_path import DT_S, Track
from services.animator.gait_person import GaitSkeleton, GaitStyle

LEG_REACH = 0.998
KNEE_MAX_RAD = math.radians(79.0)
WALK_SPEED_MPS = 1.2
SOFT_ROOT_M = 0.008
LOWER_MAX = 0.12
"""How far the pelvis sinks for a foot that is too far away, in leg lengths; beyond it the foot comes off the floor."""
PARENTS = SMPL_PARENTS.astype(np.int64)


class Drive(NamedTuple):
    """Signals that move the upper body, one value per frame."""

    walk: Array
    """How much the person walks: 0 standing, 1 at 1.2 m/s (legs of 0.80 m)."""
    stand: Array
    """1 standing, 0 walking."""
    cycle: Array
    """Gait phase in strides; the left foot strikes at whole numbers."""
    lean: Array
    """Forward lean [rad]."""
    bank: Array
    """Lean to the left, into a turn [rad]."""
    look: Array
    """Turn of the head relative to the heading [rad]."""


@njit(cache=True)
def drive_of(track: Track, style: GaitStyle, size: float) -> Drive:
    """Signals of the upper body along a track."""
    count = len(track.x)
    walk, cycle, accel, turn, look = (
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
        np.zeros(count),
    )
    bout = 0
    for i in range(count):
        walk[i] = clip(track.speed[i] / (WALK_SPEED_MPS * math.sqrt(size)), 0.0, 1.45)
        a, b = max(i - 1, 0), min(i + 1, count - 1)
        accel[i] = (track.speed[b] - track.speed[a]) / ((b - a) * DT_S)
        turn[i] = (track.psi[b] - track.psi[a]) / ((b - a) * DT_S)
        look[i] = clip(sample(track.psi, i + 7.0) - track.psi[i], -0.5, 0.5)
        while bout + 1 < len(track.bouts) and i >= (track.bouts[bout, 1] + track.bouts[bout + 1, 0]) // 2:
            bout += 1
        leads_right = len(track.bouts) > 0 and track.bouts[bout, 2] == 1
        cycle[i] = track.phase[i] + (0.5 if leads_right else 0.0)
    walk, accel, turn, look = smooth(walk, 2.5), smooth(accel, 3.0), smooth(turn, 3.0), smooth(look, 3.0)
    stand, lean, bank = np.empty(count), np.empty(count), np.empty(count)
    for i in range(count):
        stand[i] = 1.0 - ease(walk[i] / 0.35)
        lean[i] = style.lean_rad + 0.01 + 0.04 * walk[i] + 0.03 * clip(accel[i], -2.0, 2.0)
        bank[i] = clip(0.6 * turn[i] * track.speed[i] / 9.81, -0.15, 0.15)
    return Drive(walk, stand, cycle, lean, bank, look)


@njit(cache=True)
def pelvis_rotations(track: Track, drive: Drive, style: GaitStyle) -> Array:
    """Global rotation of the pelvis, shape (T, 3, 3)."""
    R = np.empty((len(track.x), 3, 3))
    for i in range(len(track.x)):
        a, turn = min(drive.walk[i], 1.2) * style.pelvis_turn, 2.0 * math.pi * drive.cycle[i]
        yaw = track.psi[i] - 0.095 * a * math.cos(turn)
        tilt = 0.055 * a * math.sin(turn - 0.15)
        R[i] = mat_mul(rot_y(yaw), mat_mul(rot_z(tilt - 0.5 * drive.bank[i]), rot_x(0.35 * drive.lean[i])))
    return R


@njit(cache=True)
def pelvis_path(
    track: Track,
    drive: Drive,
    R_pelvis: Array,
    feet: Feet,
    skeleton: GaitSkeleton,
    style: GaitStyle,
    ground: Ground,
) -> Array:
    """Pelvis positions from which both legs reach their feet, in the y-up world [m], shape (T, 3)."""
    count = len(track.x)
    P = np.empty((count, 3))
    floor_m = np.empty(count)
    for i in range(count):
        floor_m[i] = floor_at(ground, track.x[i], track.z[i])
    floor_m, root_x, root_z = smooth(floor_m, 3.0), smooth(track.x, 1.5), smooth(track.z, 1.5)
    hip_drop = -0.5 * (skeleton.offsets_m[1, 1] + skeleton.offsets_m[2, 1])
    lower = np.zeros(count)
    for i in range(count):
        a, turn = drive.walk[i], 2.0 * math.pi * drive.cycle[i]
        step = track.pace[i] / (2.0 * track.rate[i]) / skeleton.size
        bounce = clip(0.085 * step * step * style.bounce, 0.0, 0.045) * skeleton.size * min(a, 1.0)
        reach = 0.9965 - 0.010 * min(a, 1.0)
        P[i, 1] = (
            floor_m[i]
            + skeleton.sole_m
            + hip_drop
            + reach * skeleton.leg_m
            - 0.5 * bounce * (1.0 - math.cos(2.0 * turn - 0.62 * 2.0 * math.pi))
        )
        idle, t = drive.stand[i], i * DT_S
        sway = min(0.010 * skeleton.size, 0.011) * min(a, 1.0) * math.cos(turn - 0.6 * math.pi)
        sway += idle * (0.005 * math.sin(1.3 * t + style.idle_phase_rad) + 0.003 * math.sin(0.61 * t))
        rock = idle * (0.004 * math.sin(0.9 * t + 2.0 * style.idle_phase_rad) + 0.002 * math.sin(2.1 * t))
        s, c = math.sin(track.psi[i]), math.cos(track.psi[i])
        # A root that starts or stops from one row to the next is softened by under a centimetre.
        soft = SOFT_ROOT_M / (SOFT_ROOT_M + math.sqrt((root_x[i] - track.x[i]) ** 2 + (root_z[i] - track.z[i]) ** 2))
        P[i, 0] = track.x[i] + soft * (root_x[i] - track.x[i]) + sway * c + rock * s
        P[i, 2] = track.z[i] + soft * (root_z[i] - track.z[i]) - sway * s + rock * c
        for foot in range(2):
            hip = mat_vec(R_pelvis[i], skeleton.offsets_m[1 + foot])
            dx, dz = feet.ankle_m[foot, i, 0] - P[i, 0] - hip[0], feet.ankle_m[foot, i, 2] - P[i, 2] - hip[2]
            far = LEG_REACH * skeleton.leg_m
            top = feet.ankle_m[foot, i, 1] - hip[1] + math.sqrt(max(far * far - dx * dx - dz * dz, (0.6 * far) ** 2))
            lower[i] = clip(P[i, 1] - top, lower[i], LOWER_MAX * skeleton.leg_m)
    lower = smooth_above(lower, 1.0)
    for i in range(count):
        P[i, 1] -= lower[i]
    return P


@njit(cache=True)
def _pose_leg(G: Array, hip_m: Array, ankle_m: Array, foot: int, offsets_m: Array) -> None:
    """Thigh and shin rotations that put the ankle where the foot is, knee forward."""
    thigh, shin = offsets_m[4 + foot], offsets_m[7 + foot]
    l1, l2 = norm(thigh), norm(shin)
    d = ankle_m - hip_m
    nearest = math.sqrt(l1 * l1 + l2 * l2 + 2.0 * l1 * l2 * math.cos(KNEE_MAX_RAD))
    distance = clip(norm(d), nearest, 0.9995 * (l1 + l2))
    d = d / norm(d)
    pelvis, sole = G[0], G[7 + foot]
    # The knee points between where the pelvis and the foot face; the foot's side axis has no pitch in it.
    fx, fz = 1.3 * pelvis[0, 2] - sole[2, 0], 1.3 * pelvis[2, 2] + sole[0, 0]
    forward = np.array([fx, 0.0, fz])
    along = forward[0] * d[0] + forward[1] * d[1] + forward[2] * d[2]
    forward = forward - along * d
    forward = forward / norm(forward)
    cosine = clip((l1 * l1 + distance * distance - l2 * l2) / (2.0 * l1 * distance), -1.0, 1.0)
    angle = math.acos(cosine)
    knee = l1 * (math.cos(angle) * d + math.sin(angle) * forward)
    z = np.array([0.0, 0.0, 1.0])
    G[1 + foot] = mat_mul(frame_of(-knee, forward), frame_of(-thigh, z).T)
    G[4 + foot] = mat_mul(frame_of(knee - distance * d, forward), frame_of(-shin, z).T)


@njit(cache=True)
def _pose_trunk(
    G: Array, psi: float, a: float, cycle: float, lean: float, bank: float, look: float, nod: float
) -> None:
    """Spine, neck and head: the chest turns against the pelvis, the head stays level."""
    turn = 2.0 * math.pi * cycle
    yaw, tilt = -0.095 * a * math.cos(turn), 0.055 * a * math.sin(turn - 0.15)
    chest = 0.07 * a * math.cos(turn)
    G[3] = mat_mul(rot_y(psi + 0.45 * yaw), mat_mul(rot_z(0.35 * tilt - 0.7 * bank), rot_x(0.6 * lean)))
    G[6] = mat_mul(rot_y(psi + 0.55 * chest), mat_mul(rot_z(-0.1 * tilt - 0.9 * bank), rot_x(0.85 * lean)))
    G[9] = mat_mul(rot_y(psi + chest), mat_mul(rot_z(-0.25 * tilt - bank), rot_x(lean)))
    G[12] = mat_mul(rot_y(psi + 0.4 * chest + 0.5 * look), mat_mul(rot_z(-0.6 * bank), rot_x(0.7 * lean + 0.5 * nod)))
    G[15] = mat_mul(rot_y(psi + look), mat_mul(rot_z(-0.3 * bank), rot_x(0.15 * lean + nod)))


@njit(cache=True)
def _pose_arm(G: Array, side: int, a: float, cycle: float, lean: float, style: GaitStyle, sway: float) -> None:
    """An arm that hangs at the side and swings against the leg, the forearm bending forward.

    In SMPL's T-pose the palms face down, so an arm lowered about the forward axis has its palm at the thigh.
    """
    left = 1.0 if side == 0 else -1.0
    beat = -left * math.cos(2.0 * math.pi * (cycle - 0.02))
    swing = style.arm_swing * (1.0 + left * style.arm_asymmetry)
    forward = (0.29 * beat - 0.07) * a * swing + 0.02 + sway
    elbow = max(0.18 + style.elbow_rad + 0.08 * a + 0.17 * a * swing * (1.0 + beat), 0.1)
    down = 0.5 * math.pi - style.arm_abduction_rad
    G[13 + side] = mat_mul(G[9], rot_z(-left * 0.05))
    hang = mat_mul(G[9], rot_x(-0.6 * lean - forward))
    G[16 + side] = mat_mul(hang, mat_mul(rot_z(-left * down), rot_x(0.03)))
    G[18 + side] = mat_mul(G[16 + side], mat_mul(rot_y(-left * elbow), rot_x(0.10)))
    G[20 + side] = mat_mul(G[18 + side], rot_z(-left * 0.08))
    G[22 + side] = mat_mul(G[20 + side], rot_z(-left * 0.20))


@njit(cache=True)
def pose_frames(
    track: Track,
    drive: Drive,
    R_pelvis: Array,
    P: Array,
    feet: Feet,
    skeleton: GaitSkeleton,
    style: GaitStyle,
) -> Array:
    """Parent-relative axis-angle pose of every frame [rad], shape (T, 24, 3)."""
    count = len(track.x)
    pose = np.empty((count, 24, 3))
    G = np.empty((24, 3, 3))
    for i in range(count):
        a, cycle, t = min(drive.walk[i], 1.3), drive.cycle[i], i * DT_S
        breath = 0.006 * math.sin(1.6 * t + style.idle_phase_rad)
        sway = 0.015 * drive.stand[i] * math.sin(0.8 * t + 3.0 * style.idle_phase_rad)
        look = drive.look[i] + 0.05 * drive.stand[i] * math.sin(0.5 * t + style.idle_phase_rad)
        G[0] = R_pelvis[i]
        _pose_trunk(
            G,
            track.psi[i],
            a * style.pelvis_turn,
            cycle,
            drive.lean[i] + breath,
            drive.bank[i],
            look,
            style.head_pitch_rad,
        )
        for side in range(2):
            G[7 + side], G[10 + side] = feet.R_foot[side, i], feet.R_toe[side, i]
            hip = P[i] + mat_vec(G[0], skeleton.offsets_m[1 + side])
            _pose_leg(G, hip, feet.ankle_m[side, i], side, skeleton.offsets_m)
            _pose_arm(G, side, a, cycle, drive.lean[i], style, sway)
        axis_angle_of(G[0], pose[i, 0])
        for j in range(1, 24):
            axis_angle_of(mat_t_mul(G[PARENTS[j]], G[j]), pose[i, j])
    return pose
