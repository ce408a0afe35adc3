"""SMPL joint rotations from joint positions, in closed form.

Pelvis and chest are aligned with their several children (Horn); other joints turn by the shortest way so that their
bone points at the next joint. Positions do not see twists: thighs and upper arms take theirs from the plane in which
knee and elbow bend, with what a body would do where the limb is straight; the twist between pelvis and chest is shared
out over the spine; soles stay level across; forearms have the twist of relaxed ones. Head, hands and toes go with
their parents.

Legend: G = rotation of a joint in the y-up world, X = position of a fitted joint, P = position that is asked for.
"""

import math

import numpy as np
import numpy.typing as npt

from readygo.common.arrays import Float64Array
from readygo.common.avatars import SMPL_PARENTS
from readygo.common.kernels import kernel_with_cache
from readygo.services.animator.gait.math import axis_angle_of, clip, mat_mul, mat_t_mul, mat_vec, norm, smooth
from readygo.services.animator.smpl.fit_math import SMALL, across, aim, align, cross, swing, turn, twist_about, unit

PARENTS = SMPL_PARENTS.astype(np.int64)
REACH = 0.9999
"""Longest distance from hip to ankle, in lengths of the stretched leg."""
STRAIGHT_KNEE_M = 0.01
"""A knee that is closer than this to the line from hip to ankle points forward as much as it shows."""
LEVEL_MAX_RAD = 0.5
TWIST_SIGMA_FRAMES = 1.5
PRONATION_RAD = 0.25
"""Twist of a relaxed forearm that turns the palm inward; no position shows it."""
SHOULDER_WEIGHT = 0.03
"""Share of the shoulders in the chest's alignment: collar bones are short, and shoulders say better where it turns."""


def fit_rotations(
    joints_m: npt.ArrayLike, offsets_m: npt.ArrayLike, *, retarget: bool = False
) -> tuple[Float64Array, Float64Array]:
    """Rotations of a body whose joints come to lie where they are asked to.

    Args:
        joints_m: Positions of the SMPL joints 0..21 or 0..23 in y-up axes [m], shape (T, 22 or 24, 3).
        offsets_m: The body: each joint relative to its parent in SMPL's T-pose (y up) [m], shape (24, 3).
        retarget: True is for a body with other measures: arms and neck take the directions of the given bones, and
            the ankles reach their given positions at any bend of the knees. False leaves the least error.

    Returns:
        Global joint rotations, shape (T, 24, 3, 3), and fitted positions [m], shape (T, 24, 3), y-up.

    Raises:
        ValueError: If a shape is wrong or a position is not finite.
    """
    P = np.ascontiguousarray(joints_m, dtype=np.float64)
    offsets = np.ascontiguousarray(offsets_m, dtype=np.float64)
    if P.ndim != 3 or P.shape[1] not in (22, 24) or P.shape[2] != 3 or len(P) == 0 or offsets.shape != (24, 3):
        raise ValueError(
            f"joints_m must have shape (T, 22 or 24, 3), T >= 1, and offsets_m (24, 3); got {P.shape} and "
            f"{offsets.shape}."
        )
    if not np.isfinite(P).all():
        row = int(np.argmax(~np.isfinite(P).all(axis=(1, 2))))
        raise ValueError(f"joints_m must be finite, row {row} is not; fill gaps before the fit.")
    G, X = np.empty((len(P), 24, 3, 3)), np.empty((len(P), 24, 3))
    normals = np.empty((len(P), 4, 3))
    for row in range(len(P)):
        _fit_trunk(P[row], offsets, retarget, G[row], X[row])
        _find_bends(P[row], offsets, retarget, G[row], X[row], normals[row])
    _smooth_normals(normals)
    for row in range(len(P)):
        _fit_limbs(P[row], offsets, retarget, normals[row], G[row], X[row])
    return G, X


def pose_of(G: Float64Array) -> Float64Array:
    """Parent-relative axis-angle vectors [rad] of global rotations (T, 24, 3, 3), shape (T, 24, 3)."""
    pose = np.empty((len(G), 24, 3))
    _fill_pose(G, pose)
    return pose


@kernel_with_cache
def _fill_pose(G: Float64Array, pose: Float64Array) -> None:
    for t in range(len(G)):
        axis_angle_of(G[t, 0], pose[t, 0])
        for j in range(1, 24):
            axis_angle_of(mat_t_mul(G[t, PARENTS[j]], G[t, j]), pose[t, j])


@kernel_with_cache
def _place(joint: int, offsets: Float64Array, G: Float64Array, X: Float64Array) -> None:
    parent = PARENTS[joint]
    X[joint] = X[parent] + mat_vec(G[parent], offsets[joint])


@kernel_with_cache
def _toward(
    joint: int, child: int, P: Float64Array, X: Float64Array, retarget: bool, fallback: Float64Array
) -> Float64Array:
    """Unit direction from a joint to the place of its child."""
    return unit(P[child] - (P[joint] if retarget else X[joint]), fallback)


@kernel_with_cache
def _swing_to(
    joint: int, child: int, base: Float64Array, P: Float64Array, X: Float64Array, retarget: bool, offsets: Float64Array
) -> Float64Array:
    bone = offsets[child]
    now = unit(mat_vec(base, bone), base[:, 1])
    return swing(base, bone, _toward(joint, child, P, X, retarget, now))


@kernel_with_cache
def _fit_trunk(P: Float64Array, offsets: Float64Array, retarget: bool, G: Float64Array, X: Float64Array) -> None:
    """Pelvis, spine, chest, collars, neck and head."""
    ones = np.ones(3)
    source, target = np.empty((3, 3)), np.empty((3, 3))
    for k in range(3):
        source[k], target[k] = offsets[1 + k], P[1 + k] - P[0]
    X[0] = P[0]
    G[0] = align(source, target, ones)
    # The chest's bones carry five points: neck, collars and, at the end of them, the shoulders.
    source5, target5, weight = np.empty((5, 3)), np.empty((5, 3)), np.ones(5)
    for k in range(5):
        joint = 12 + k if k < 3 else 13 + k
        source5[k] = offsets[joint] if k < 3 else offsets[joint - 3] + offsets[joint]
        target5[k] = P[joint] - P[9]
    weight[3:] = SHOULDER_WEIGHT
    chest = align(source5, target5, weight)
    for joint, child in ((3, 6), (6, 9)):
        _place(joint, offsets, G, X)
        G[joint] = _swing_to(joint, child, G[PARENTS[joint]], P, X, retarget, offsets)
    axis = unit(offsets[9], np.array([0.0, 1.0, 0.0]))
    third = twist_about(mat_t_mul(G[6], chest), axis) / 3.0
    G[3] = mat_mul(turn(unit(mat_vec(G[3], offsets[6]), G[3, :, 1]), third), G[3])
    _place(6, offsets, G, X)
    G[6] = _swing_to(6, 9, G[3], P, X, retarget, offsets)
    G[6] = mat_mul(turn(mat_vec(G[6], axis), third), G[6])
    _place(9, offsets, G, X)
    G[9] = chest
    for joint, child in ((12, 15), (13, 16), (14, 17)):
        _place(joint, offsets, G, X)
        G[joint] = _swing_to(joint, child, G[9], P, X, retarget, offsets)
    _place(15, offsets, G, X)
    G[15] = G[12]
    for joint in (1, 2, 16, 17):
        _place(joint, offsets, G, X)


@kernel_with_cache
def _find_bends(
    P: Float64Array, offsets: Float64Array, retarget: bool, G: Float64Array, X: Float64Array, normals: Float64Array
) -> None:
    """Where knees and elbows are, and the normals of the planes in which they bend (legs 0 and 1, arms 2 and 3)."""
    for side in range(2):
        hip, knee, ankle = 1 + side, 4 + side, 7 + side
        foot = unit(P[10 + side] - P[ankle], G[0, :, 2])
        if retarget:
            X[knee], X[ankle] = _reach(X[hip], P[knee], P[ankle], foot, offsets[knee], offsets[ankle])
        else:
            X[knee] = X[hip] + norm(offsets[knee]) * unit(P[knee] - X[hip], -G[0, :, 1])
            X[ankle] = X[knee] + norm(offsets[ankle]) * unit(P[ankle] - X[knee], -G[0, :, 1])
        thigh, shin = unit(X[knee] - X[hip], -G[0, :, 1]), unit(X[ankle] - X[knee], -G[0, :, 1])
        normals[side] = cross(thigh, shin) - 0.2 * cross(thigh, foot) + 0.1 * across(G[0, :, 0], thigh)
        shoulder, elbow, wrist = 16 + side, 18 + side, 20 + side
        collar = G[13 + side]
        bone = unit(offsets[elbow], collar[:, 0])
        hinge = cross(bone, np.array([0.0, 0.0, 1.0]))
        upper = _toward(shoulder, elbow, P, X, retarget, mat_vec(collar, bone))
        relaxed = swing(collar, bone, upper)
        X[elbow] = X[shoulder] + norm(offsets[elbow]) * upper
        fore = _toward(elbow, wrist, P, X, retarget, upper)
        normals[2 + side] = cross(upper, fore) + 0.1 * mat_vec(relaxed, hinge)


@kernel_with_cache
def _reach(
    hip: Float64Array,
    knee: Float64Array,
    ankle: Float64Array,
    foot: Float64Array,
    thigh: Float64Array,
    shin: Float64Array,
) -> tuple[Float64Array, Float64Array]:
    """Knee and ankle of a leg that reaches for an ankle, its knee on the side of the knee that is asked for."""
    l1, l2 = norm(thigh), norm(shin)
    u = unit(ankle - hip, np.array([0.0, -1.0, 0.0]))
    d = clip(norm(ankle - hip), abs(l1 - l2) + 1e-4, REACH * (l1 + l2))
    side = across(knee - hip, u)
    short = STRAIGHT_KNEE_M - norm(side)
    if short > 0.0:
        side = side + short * across(foot, u)
    fallback = across(np.array([u[1], -u[0], 0.37]), u)
    side = unit(side, fallback / norm(fallback))
    along = (l1 * l1 - l2 * l2 + d * d) / (2.0 * d)
    out = math.sqrt(max(l1 * l1 - along * along, 0.0))
    return hip + along * u + out * side, hip + d * u


@kernel_with_cache
def _smooth_normals(normals: Float64Array) -> None:
    for limb in range(4):
        for k in range(3):
            normals[:, limb, k] = smooth(normals[:, limb, k].copy(), TWIST_SIGMA_FRAMES)


@kernel_with_cache
def _upper_limb(
    base: Float64Array, bone: Float64Array, hinge: Float64Array, direction: Float64Array, normal: Float64Array
) -> Float64Array:
    """Rotation of a thigh or an upper arm: its bone along a direction, its hinge along the normal if there is one."""
    if norm(across(normal, direction)) < 1e-6 or norm(across(hinge, unit(bone, direction))) < 1e-6:
        return swing(base, bone, direction)
    return aim(bone, hinge, direction, normal)


@kernel_with_cache
def _fit_limbs(
    P: Float64Array, offsets: Float64Array, retarget: bool, normals: Float64Array, G: Float64Array, X: Float64Array
) -> None:
    """Legs, feet, arms and hands, once knees and elbows are placed."""
    forward = np.array([0.0, 0.0, 1.0])
    for side in range(2):
        hip, knee, ankle, ball = 1 + side, 4 + side, 7 + side, 10 + side
        thigh, shin = unit(X[knee] - X[hip], -G[0, :, 1]), unit(X[ankle] - X[knee], -G[0, :, 1])
        G[hip] = _upper_limb(G[0], offsets[knee], np.array([1.0, 0.0, 0.0]), thigh, normals[side])
        G[knee] = swing(G[hip], offsets[ankle], shin)
        G[ankle] = _level(_swing_to(ankle, ball, G[knee], P, X, True, offsets), offsets[ball])
        _place(ball, offsets, G, X)
        G[ball] = G[ankle]
        shoulder, elbow, wrist, hand = 16 + side, 18 + side, 20 + side, 22 + side
        collar = G[13 + side]
        upper = unit(X[elbow] - X[shoulder], mat_vec(collar, offsets[elbow]))
        hinge = cross(offsets[elbow], forward)
        G[shoulder] = _upper_limb(collar, offsets[elbow], hinge, upper, normals[2 + side])
        G[elbow] = _swing_to(elbow, wrist, G[shoulder], P, X, retarget, offsets)
        inward = PRONATION_RAD if side == 0 else -PRONATION_RAD
        G[elbow] = mat_mul(G[elbow], turn(unit(offsets[wrist], forward), inward))
        _place(wrist, offsets, G, X)
        G[wrist] = _swing_to(wrist, hand, G[elbow], P, X, retarget, offsets) if len(P) == 24 else G[elbow].copy()
        _place(hand, offsets, G, X)
        G[hand] = G[wrist]


@kernel_with_cache
def _level(G: Float64Array, foot: Float64Array) -> Float64Array:
    """A foot turned about its length so that the sole is level across; less so the steeper the foot is."""
    axis = unit(mat_vec(G, foot), G[:, 2])
    side, up = G[:, 0], cross(axis, G[:, 0])
    flat = 1.0 - axis[1] * axis[1]
    if flat < SMALL:
        return G.copy()
    angle = clip(math.atan2(-side[1], max(up[1], 0.2)), -LEVEL_MAX_RAD, LEVEL_MAX_RAD)
    return mat_mul(turn(axis, flat * flat * angle), G)
