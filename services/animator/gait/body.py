"""The body above the feet: pelvis, legs by inverse kinematics, trunk, head and arms."""

import math
from typing import NamedTuple

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars import SMPL_PARENTS
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot.kinematics import DT_S
from readygo.services.animator.gait.curves import (
    ARM_FLEXION,
    BODY,
    CHEST_LEAN,
    CHEST_LIST,
    CHEST_YAW,
    HIP_HEIGHT,
    HIP_SURGE,
    HIP_SWAY,
    PELVIS_LIST,
    PELVIS_TILT,
    PELVIS_YAW,
    Curves,
    gain_of,
    mix_clips,
    swing_of_body,
    weights_of,
)
from readygo.services.animator.gait.feet import Feet
from readygo.services.animator.gait.human import GaitSkeleton, GaitStyle
from readygo.services.animator.gait.math import (
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
from readygo.services.animator.gait.path import GaitTrack

LEG_REACH = 0.998
KNEE_MAX_RAD, RUN_KNEE_MAX_RAD = math.radians(79.8), math.radians(125.0)
WALK_SPEED_MPS = 1.2
STAND_REACH = 0.994
"""Height of the hips over the ankles of someone who stands, in leg lengths."""
WALK_BOUNCE = 1.35
"""Vertical oscillation of a walk relative to the mocap's, whose subject walks flatter than most: 2.5 cm at 1.2 m/s
against 3.6 cm of 24 other walks."""
CHEST_COUNTER_RAD = 0.035
"""Added turn of the shoulders against the pelvis at 1.2 m/s; the mocap's subject keeps the chest still."""
SWAY_SHARE, SURGE_SHARE = 0.4, 0.5
"""Shares of the mocap's sideways and forward sway that keep the root within 2 cm of its trajectory."""
WALK_ELBOW_SHARE = 0.55
"""Share of the mocap's elbow bend in a walk: its subject lifts the hands more than most people do."""
ABDUCTION_SHARE = 0.4
SOFT_ROOT_M = 0.008
LOWER_MAX = 0.12
"""How far the pelvis sinks for a foot that is too far away, in leg lengths; beyond it the foot comes off the floor."""
RAISE_MAX = 0.10
SHIFT_M, SHIFT_LIST_RAD = 0.010, 0.030
"""How far someone who stands shifts the weight to a side, and how much the pelvis drops on the other one."""
PARENTS = SMPL_PARENTS.astype(np.int64)
RIGHT_ARM = BODY
"""Channels of the right arm follow those of the body, in the order of the left one's."""


class BodySignals(NamedTuple):
    """Signals that move the body, one value per frame."""

    walk: Float64Array
    """How much the person walks: 0 standing, 1 at 1.2 m/s (legs of 0.80 m)."""
    stand: Float64Array
    """1 standing, 0 walking."""
    run: Float64Array
    """1 running, 0 walking or standing."""
    body: Float64Array
    """Channels of `gait_curves`, and those of the right arm, shape (T, BODY + 3)."""
    lean: Float64Array
    """Forward lean [rad]."""
    bank: Float64Array
    """Lean to the left, into a turn [rad]."""
    look: Float64Array
    """Turn of the head relative to the heading [rad]."""
    shift: Float64Array
    """Weight of someone who stands: 1 on the left foot, -1 on the right one, 0 walking."""


@kernel_with_cache
def _fill_body(
    out: Float64Array, curves: Curves, speed: float, run: float, moving: float, cycle: float, style: GaitStyle
) -> None:
    """Channels of the body at a gait phase."""
    weights = weights_of(curves, speed, run)
    gain = gain_of(curves, weights, speed, run) * moving
    for channel in range(BODY):
        out[channel] = gain * swing_of_body(curves.body, weights, channel, cycle)
    for n in range(3):
        channel = ARM_FLEXION + n
        out[RIGHT_ARM + n] = gain * swing_of_body(curves.body, weights, channel, cycle + 0.5)
        mean = gain * mix_clips(curves.body[:, channel, 0], weights)
        out[channel] += mean
        out[RIGHT_ARM + n] += mean
    out[CHEST_YAW] += CHEST_COUNTER_RAD * gain * (1.0 - run) * math.cos(2.0 * math.pi * cycle)
    bounce = style.bounce * (WALK_BOUNCE + run * (1.0 - WALK_BOUNCE))
    height = mix_clips(curves.body[:, HIP_HEIGHT, 0], weights)
    out[HIP_HEIGHT] = STAND_REACH + gain * (min(gain, 1.0) ** 2 * (height - STAND_REACH) + bounce * out[HIP_HEIGHT])


@kernel_with_cache
def _weight_shift(time_s: float, phase: float) -> float:
    """Someone who stands rests on one leg, then on the other: a soft square wave of uneven periods."""
    wave = math.sin(0.52 * time_s + phase) + 0.6 * math.sin(0.23 * time_s + 2.3 * phase)
    return wave / math.sqrt(0.15 + wave * wave)


@kernel_with_cache
def drive_of(track: GaitTrack, style: GaitStyle, size: float, curves: Curves) -> BodySignals:
    """Signals of the body along a track."""
    count = len(track.x)
    walk, accel, turn, look = np.zeros(count), np.zeros(count), np.zeros(count), np.zeros(count)
    for i in range(count):
        walk[i] = clip(track.speed[i] / (WALK_SPEED_MPS * math.sqrt(size)), 0.0, 3.0)
        a, b = max(i - 1, 0), min(i + 1, count - 1)
        accel[i] = (track.speed[b] - track.speed[a]) / ((b - a) * DT_S)
        turn[i] = (track.psi[b] - track.psi[a]) / ((b - a) * DT_S)
        look[i] = clip(sample(track.psi, i + 7.0) - track.psi[i], -0.5, 0.5)
    walk, accel, turn, look = smooth(walk, 2.5), smooth(accel, 3.0), smooth(turn, 3.0), smooth(look, 3.0)
    stand, lean, bank, shift = np.empty(count), np.empty(count), np.empty(count), np.empty(count)
    body = np.empty((count, BODY + 3))
    bout = 0
    for i in range(count):
        while bout + 1 < len(track.bouts) and i >= (track.bouts[bout, 1] + track.bouts[bout + 1, 0]) // 2:
            bout += 1
        leads_right = len(track.bouts) > 0 and track.bouts[bout, 2] == 1
        cycle = track.phase[i] + (0.5 if leads_right else 0.0)
        stand[i] = 1.0 - ease(walk[i] / 0.35)
        _fill_body(body[i], curves, walk[i] * WALK_SPEED_MPS, track.run[i], 1.0 - stand[i], cycle, style)
        lean[i] = style.lean_rad + 0.01 + 0.04 * min(walk[i], 2.2) + 0.03 * clip(accel[i], -2.0, 2.0)
        bank[i] = clip(0.6 * turn[i] * track.speed[i] / 9.81, -0.15, 0.15)
        shift[i] = _weight_shift(i * DT_S, style.idle_phase_rad) * ease(2.0 * stand[i] - 1.0)
    return BodySignals(walk, stand, track.run, body, lean, bank, look, smooth(shift, 5.0))


@kernel_with_cache
def pelvis_rotations(track: GaitTrack, drive: BodySignals, style: GaitStyle) -> Float64Array:
    """Global rotation of the pelvis, shape (T, 3, 3)."""
    R = np.empty((len(track.x), 3, 3))
    for i in range(len(track.x)):
        body = drive.body[i]
        yaw = track.psi[i] + style.pelvis_turn * body[PELVIS_YAW]
        tilt = style.pelvis_turn * body[PELVIS_LIST] + SHIFT_LIST_RAD * drive.shift[i]
        pitch = 0.35 * drive.lean[i] + body[PELVIS_TILT]
        R[i] = mat_mul(rot_y(yaw), mat_mul(rot_z(tilt - 0.5 * drive.bank[i]), rot_x(pitch)))
    return R


@kernel_with_cache
def _sway(drive: BodySignals, i: int, style: GaitStyle, leg_m: float) -> tuple[float, float]:
    """Sideways and forward offset of the pelvis from its trajectory [m]."""
    idle, t = drive.stand[i], i * DT_S
    sway = clip(SWAY_SHARE * leg_m * drive.body[i, HIP_SWAY], -0.012, 0.012) + SHIFT_M * drive.shift[i]
    sway += idle * 0.002 * math.sin(1.3 * t + style.idle_phase_rad)
    rock = clip(SURGE_SHARE * leg_m * drive.body[i, HIP_SURGE], -0.010, 0.010)
    rock += idle * (0.004 * math.sin(0.9 * t + 2.0 * style.idle_phase_rad) + 0.002 * math.sin(2.1 * t))
    return sway, rock


@kernel_with_cache
def pelvis_path(
    track: GaitTrack,
    drive: BodySignals,
    R_pelvis: Float64Array,
    feet: Feet,
    skeleton: GaitSkeleton,
    style: GaitStyle,
    ground: Ground,
) -> Float64Array:
    """Pelvis positions from which both legs reach their feet, in the y-up world [m], shape (T, 3)."""
    count = len(track.x)
    P = np.empty((count, 3))
    floor_m = np.empty(count)
    for i in range(count):
        floor_m[i] = floor_at(ground, track.x[i], track.z[i])
    floor_m, root_x, root_z = smooth(floor_m, 3.0), smooth(track.x, 1.5), smooth(track.z, 1.5)
    hip_drop = -0.5 * (skeleton.offsets_m[1, 1] + skeleton.offsets_m[2, 1])
    for i in range(count):
        P[i, 1] = floor_m[i] + skeleton.sole_m + hip_drop + skeleton.leg_m * drive.body[i, HIP_HEIGHT]
        P[i, 1] -= 0.006 * skeleton.leg_m * drive.shift[i] * drive.shift[i]
        sway, rock = _sway(drive, i, style, skeleton.leg_m)
        s, c = math.sin(track.psi[i]), math.cos(track.psi[i])
        # A root that starts or stops from one row to the next is softened by under a centimetre.
        soft = SOFT_ROOT_M / (SOFT_ROOT_M + math.sqrt((root_x[i] - track.x[i]) ** 2 + (root_z[i] - track.z[i]) ** 2))
        P[i, 0] = track.x[i] + soft * (root_x[i] - track.x[i]) + sway * c + rock * s
        P[i, 2] = track.z[i] + soft * (root_z[i] - track.z[i]) - sway * s + rock * c
    _keep_in_reach(P, drive.run, R_pelvis, feet, skeleton)
    return P


@kernel_with_cache
def _nearest(run: float, skeleton: GaitSkeleton) -> float:
    """Least distance of hip and ankle [m], with the knee bent as far as people bend it."""
    l1, l2 = norm(skeleton.offsets_m[4]), norm(skeleton.offsets_m[7])
    bend = KNEE_MAX_RAD + run * (RUN_KNEE_MAX_RAD - KNEE_MAX_RAD)
    return math.sqrt(l1 * l1 + l2 * l2 + 2.0 * l1 * l2 * math.cos(bend))


@kernel_with_cache
def _keep_in_reach(
    P: Float64Array, run: Float64Array, R_pelvis: Float64Array, feet: Feet, skeleton: GaitSkeleton
) -> None:
    """Raise the pelvis where a knee would bend too far, then lower it where a foot would be too far away."""
    far = LEG_REACH * skeleton.leg_m
    for lowering in range(2):
        shift = np.zeros(len(P))
        for i in range(len(P)):
            for foot in range(2):
                hip = mat_vec(R_pelvis[i], skeleton.offsets_m[1 + foot])
                dx, dz = feet.ankle_m[foot, i, 0] - P[i, 0] - hip[0], feet.ankle_m[foot, i, 2] - P[i, 2] - hip[2]
                reach = far if lowering == 1 else _nearest(run[i], skeleton)
                over = feet.ankle_m[foot, i, 1] - hip[1] - P[i, 1]
                over += math.sqrt(max(reach * reach - dx * dx - dz * dz, lowering * (0.6 * far) ** 2))
                if lowering == 1:
                    shift[i] = clip(-over, shift[i], LOWER_MAX * skeleton.leg_m)
                else:
                    shift[i] = clip(over, shift[i], RAISE_MAX * skeleton.leg_m)
        shift = smooth_above(shift, 0.8)
        for i in range(len(P)):
            P[i, 1] += shift[i] * (1.0 - 2.0 * lowering)


@kernel_with_cache
def _pose_leg(
    G: Float64Array, hip_m: Float64Array, ankle_m: Float64Array, foot: int, nearest_m: float, offsets_m: Float64Array
) -> None:
    """Thigh and shin rotations that put the ankle where the foot is, knee forward."""
    thigh, shin = offsets_m[4 + foot], offsets_m[7 + foot]
    l1, l2 = norm(thigh), norm(shin)
    d = ankle_m - hip_m
    distance = clip(norm(d), nearest_m, 0.9995 * (l1 + l2))
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


@kernel_with_cache
def _pose_trunk(
    G: Float64Array, psi: float, drive: BodySignals, i: int, style: GaitStyle, breath: float, look: float
) -> float:
    """Spine, neck and head: the chest turns against the pelvis, the head stays level. Returns the chest's turn."""
    body, lean, bank = drive.body[i], drive.lean[i] + breath, drive.bank[i]
    yaw, tilt = style.pelvis_turn * body[PELVIS_YAW], style.pelvis_turn * body[PELVIS_LIST]
    tilt += SHIFT_LIST_RAD * drive.shift[i]
    chest: float = style.pelvis_turn * body[CHEST_YAW]
    side = body[CHEST_LIST] - 0.3 * SHIFT_LIST_RAD * drive.shift[i]
    lean_chest, nod = lean + body[CHEST_LEAN], style.head_pitch_rad
    for joint, up in ((3, 0.35), (6, 0.7), (9, 1.0)):
        turn = rot_y(psi + (1.0 - up) * yaw + up * chest)
        tip = rot_z((1.0 - up) * tilt + up * side - (0.5 + 0.5 * up) * bank)
        G[joint] = mat_mul(turn, mat_mul(tip, rot_x((0.35 + 0.65 * up) * lean_chest)))
    G[12] = mat_mul(
        rot_y(psi + 0.4 * chest + 0.5 * look), mat_mul(rot_z(0.4 * side - 0.6 * bank), rot_x(0.7 * lean + 0.5 * nod))
    )
    G[15] = mat_mul(rot_y(psi + look), mat_mul(rot_z(-0.3 * bank), rot_x(0.15 * lean + nod)))
    return chest


@kernel_with_cache
def _pose_arm(
    G: Float64Array, side: int, heading: float, drive: BodySignals, i: int, style: GaitStyle, sway: float
) -> None:
    """An arm that hangs at the side and swings against the leg, the forearm bending forward.

    In SMPL's T-pose the palms face down, so an arm lowered about the forward axis has its palm at the thigh.
    """
    left = 1.0 if side == 0 else -1.0
    first = ARM_FLEXION if side == 0 else RIGHT_ARM
    flexion, abduction, elbow = drive.body[i, first], drive.body[i, first + 1], drive.body[i, first + 2]
    swing = style.arm_swing * (1.0 + left * style.arm_asymmetry)
    forward = swing * flexion + 0.03 * drive.stand[i] + sway
    out = style.arm_abduction_rad + ABDUCTION_SHARE * swing * abduction
    share = swing * (WALK_ELBOW_SHARE + (1.0 - WALK_ELBOW_SHARE) * drive.run[i])
    bend = max(0.10 + style.elbow_rad + 0.10 * drive.stand[i] + share * elbow, 0.1)
    G[13 + side] = mat_mul(G[9], rot_z(-left * 0.05))
    hang = mat_mul(rot_y(heading), mat_mul(rot_z(-0.7 * drive.bank[i]), rot_x(-forward)))
    # Bent forearms swing inwards.
    turned = mat_mul(rot_z(-left * (0.5 * math.pi - out)), rot_x(0.03 + 0.18 * bend))
    G[16 + side] = mat_mul(hang, turned)
    G[18 + side] = mat_mul(G[16 + side], mat_mul(rot_y(-left * bend), rot_x(0.10)))
    G[20 + side] = mat_mul(G[18 + side], rot_z(-left * 0.08))
    G[22 + side] = mat_mul(G[20 + side], rot_z(-left * 0.20))


@kernel_with_cache
def pose_frames(
    track: GaitTrack,
    drive: BodySignals,
    R_pelvis: Float64Array,
    P: Float64Array,
    feet: Feet,
    skeleton: GaitSkeleton,
    style: GaitStyle,
) -> Float64Array:
    """Parent-relative axis-angle pose of every frame [rad], shape (T, 24, 3)."""
    count = len(track.x)
    pose = np.empty((count, 24, 3))
    G = np.empty((24, 3, 3))
    for i in range(count):
        t, idle = i * DT_S, drive.stand[i]
        breath = 0.006 * math.sin(1.6 * t + style.idle_phase_rad)
        sway = 0.015 * idle * math.sin(0.8 * t + 3.0 * style.idle_phase_rad)
        glance = 0.10 * math.sin(0.5 * t + style.idle_phase_rad) + 0.06 * math.sin(0.83 * t + 4.0 * style.lead_left)
        G[0] = R_pelvis[i]
        chest = _pose_trunk(G, track.psi[i], drive, i, style, breath, drive.look[i] + idle * glance)
        for side in range(2):
            G[7 + side], G[10 + side] = feet.R_foot[side, i], feet.R_toe[side, i]
            hip = P[i] + mat_vec(G[0], skeleton.offsets_m[1 + side])
            _pose_leg(G, hip, feet.ankle_m[side, i], side, _nearest(drive.run[i], skeleton), skeleton.offsets_m)
            _pose_arm(G, side, track.psi[i] + chest, drive, i, style, sway)
        axis_angle_of(G[0], pose[i, 0])
        for j in range(1, 24):
            axis_angle_of(mat_t_mul(G[PARENTS[j]], G[j]), pose[i, j])
    return pose
