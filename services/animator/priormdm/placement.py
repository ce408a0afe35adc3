"""Puts generated joints on the scene's floor, with the measures of the body that will wear them."""

import math

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.kernels import kernel_with_cache
from readygo.common.robot.kinematics import DT_S
from readygo.services.animator.gait.human import GaitSkeleton
from readygo.services.animator.gait.math import Ground, clip, ease, floor_at, mat_mul, rot_x, smooth, smooth_above
from readygo.services.animator.smpl.fit import REACH, fit_rotations

HUMANML3D_LEG_M = 0.821
"""Thigh and shin of the skeleton that HumanML3D's motions are brought to, its file 000021."""
FLOOR_SIGMA_FRAMES = 4.0
LOWER_MAX = 0.12
"""How far the body sinks for a foot that is too far away, in leg lengths."""
LOWER_SIGMA_FRAMES = 2.0
REST_HEIGHT_M = 0.04
REST_SPEED_MPS = 0.5
REST_FRAMES = 3
"""The ball of a foot that is lower and slower than this for at least so many frames rests on the floor."""
HOLD_MAX_M = 0.06
"""A resting foot is moved at most this far to where it rests on average."""
TOE_BEND_MAX_RAD = 1.0
TOE_SIGMA_FRAMES = 0.7


def wear(joints_m: Float64Array, skeleton: GaitSkeleton, ground: Ground) -> tuple[Float64Array, Float64Array]:
    """Rotations and pelvis of a body that moves as the given joints do.

    The ankles go where the joints say, over the floor below each foot; the pelvis keeps its place on the map, and its
    height over the feet unless a leg would have to stretch.

    Args:
        joints_m: Joints 0..21 in y-up axes over a floor at y = 0 [m], of a skeleton with the body's leg length and the
            balls of its feet at y = 0, shape (T, 22, 3).
        skeleton: The body.
        ground: The floor.

    Returns:
        Global rotations (T, 24, 3, 3) and pelvis positions [m] (T, 3), y-up.
    """
    joints = joints_m.copy()
    offsets = skeleton.offsets_m
    _hold_feet(joints)
    hips_below = float(np.mean(joints[:, 0, 1] - 0.5 * (joints[:, 1, 1] + joints[:, 2, 1])))
    raise_m = -0.5 * (offsets[1, 1] + offsets[2, 1]) - hips_below
    _onto_floor(joints, ground, skeleton.sole_m, skeleton.toe_sole_m, float(raise_m))
    G, X = fit_rotations(joints, offsets, retarget=True)
    sink = _sink(X, joints, skeleton.leg_m)
    if sink.max() > 0.0:
        upper = [j for j in range(22) if j not in (4, 5, 7, 8, 10, 11)]
        joints[:, upper, 1] -= sink[:, None]
        G, X = fit_rotations(joints, offsets, retarget=True)
    _bend_toes(G, X, ground, skeleton.toe_sole_m, skeleton.toe_m - 0.5 * float(offsets[10, 2] + offsets[11, 2]))
    return G, X[:, 0].copy()


@kernel_with_cache
def _hold_feet(joints: Float64Array) -> None:
    """Keep the balls of resting feet from sliding; between two rests the correction fades from one to the other."""
    count = len(joints)
    for side in range(2):
        ball = joints[:, 10 + side].copy()
        rests = _rests(ball)
        shift = np.zeros((count, 2))
        last = -1
        for first, end in rests:
            for k in range(2):
                axis = 2 * k
                mean = np.mean(ball[first:end, axis])
                for t in range(first, end):
                    shift[t, k] = clip(mean - ball[t, axis], -HOLD_MAX_M, HOLD_MAX_M)
                for t in range(last + 1, first):
                    before = shift[last, k] if last >= 0 else 0.0
                    shift[t, k] = before + (shift[first, k] - before) * ease((t - last) / (first - last))
            last = end - 1
        for t in range(count):
            for k in range(2):
                joints[t, 7 + side, 2 * k] += shift[t, k]
                joints[t, 10 + side, 2 * k] += shift[t, k]


@kernel_with_cache
def _rests(ball: Float64Array) -> Int64Array:
    """First row and the row after the last one of every rest of a ball (T, 3), shape (R, 2)."""
    count = len(ball)
    rests = np.empty((count, 2), np.int64)
    found, first = 0, -1
    for t in range(count + 1):
        resting = False
        if t < count:
            a, b = max(t - 1, 0), min(t + 1, count - 1)
            way = math.sqrt((ball[b, 0] - ball[a, 0]) ** 2 + (ball[b, 2] - ball[a, 2]) ** 2)
            resting = ball[t, 1] < REST_HEIGHT_M and way <= REST_SPEED_MPS * DT_S * (b - a)
        if resting and first < 0:
            first = t
        elif not resting and first >= 0:
            if t - first >= REST_FRAMES:
                rests[found, 0], rests[found, 1] = first, t
                found += 1
            first = -1
    return rests[:found]


@kernel_with_cache
def _onto_floor(joints: Float64Array, ground: Ground, sole: float, ball_sole: float, raise_m: float) -> None:
    count = len(joints)
    base = np.empty(count)
    for t in range(count):
        floors = 0.0
        for side in range(2):
            ankle, ball = joints[t, 7 + side], joints[t, 10 + side]
            below_ankle, below_ball = floor_at(ground, ankle[0], ankle[2]), floor_at(ground, ball[0], ball[2])
            ankle[1] = below_ankle + max(ankle[1] + ball_sole, sole)
            ball[1] = below_ball + max(ball[1] + ball_sole, ball_sole)
            floors += 0.5 * below_ankle
        base[t] = floors
    base = smooth(base, FLOOR_SIGMA_FRAMES)
    for t in range(count):
        for j in range(22):
            if j == 4 or j == 5:
                joints[t, j, 1] += base[t] + ball_sole
            elif j != 7 and j != 8 and j != 10 and j != 11:
                joints[t, j, 1] += base[t] + ball_sole + raise_m


@kernel_with_cache
def _sink(X: Float64Array, joints: Float64Array, leg: float) -> Float64Array:
    """How far the body must be lower for both ankles to be within reach [m], smooth over time."""
    count = len(X)
    need = np.zeros(count)
    reach = REACH * leg
    for t in range(count):
        for side in range(2):
            hip, ankle = X[t, 1 + side], joints[t, 7 + side]
            flat = (hip[0] - ankle[0]) ** 2 + (hip[2] - ankle[2]) ** 2
            top = ankle[1] + math.sqrt(max(reach * reach - flat, 0.0))
            need[t] = max(need[t], clip(hip[1] - top, 0.0, LOWER_MAX * leg))
    if need.max() <= 0.0:
        return need
    return smooth_above(need, LOWER_SIGMA_FRAMES)


@kernel_with_cache
def _bend_toes(G: Float64Array, X: Float64Array, ground: Ground, ball_sole: float, toes_m: float) -> None:
    """Bend the toes up, at least as far as their tip would else be in the floor."""
    for side in range(2):
        bend = np.zeros(len(G))
        for t in range(len(G)):
            bend[t] = _toe_bend(G[t, 7 + side], X[t, 10 + side], ground, ball_sole, toes_m)
        bend = smooth_above(bend, TOE_SIGMA_FRAMES)
        for t in range(len(G)):
            G[t, 10 + side] = mat_mul(G[t, 7 + side], rot_x(-bend[t]))


@kernel_with_cache
def _toe_bend(foot: Float64Array, ball: Float64Array, ground: Ground, ball_sole: float, toes_m: float) -> float:
    tip_x = ball[0] - foot[0, 1] * ball_sole + foot[0, 2] * toes_m
    tip_z = ball[2] - foot[2, 1] * ball_sole + foot[2, 2] * toes_m
    clearance = ball[1] - floor_at(ground, tip_x, tip_z)
    # Height of the tip over the ball's joint at a bend: a cos + b sin.
    a = -foot[1, 1] * ball_sole + foot[1, 2] * toes_m
    b = foot[1, 1] * toes_m + foot[1, 2] * ball_sole
    if clearance + a >= 0.0:
        return 0.0
    low, high = 0.0, TOE_BEND_MAX_RAD
    for _ in range(20):
        middle = 0.5 * (low + high)
        if clearance + a * math.cos(middle) + b * math.sin(middle) < 0.0:
            low = middle
        else:
            high = middle
    return high
