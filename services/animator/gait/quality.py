"""How well a motion would pass for a person: measured on the message alone, without the generator's own knowledge."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars import Avatar
from readygo.common.avatars.kinematics import fill_globals
from readygo.common.frames import matrix_from_axis_angle
from readygo.common.maps.grid import FloorMap
from readygo.common.messages import Motion
from readygo.services.animator.gait.human import GaitSkeleton, skeleton_of

STILL_MPS = 0.1
"""A sole whose lowest point is slower than this over four consecutive rows stands still."""
CONTACT_HEIGHT_M = 0.003
"""A point of the sole that is lower than this in two consecutive rows is in contact."""
SOLE_HALF_WIDTH_M = 0.035


@dataclass(frozen=True, kw_only=True)
class MotionQuality:
    """Numbers that a plausible motion keeps small, or within a person's range."""

    skate_mean_cmps: float
    """Horizontal speed of sole points in contact [cm/s], mean over contacts."""
    skate_max_cmps: float
    penetration_max_mm: float
    """Deepest sole point below the floor."""
    hover_max_mm: float
    """Largest height above the floor of the lowest point of a sole that stands still."""
    airborne_max_mm: float
    """Largest height above the floor of the lowest sole point of both feet [mm]: a walk has no flight phase."""
    root_error_max_cm: float
    """Horizontal distance of the pelvis from the trajectory, over the trajectory's rows."""
    knee_min_deg: float
    knee_max_deg: float
    elbow_min_deg: float
    """Bend of the elbow; negative would be backwards."""
    pelvis_oscillation_cm: float
    """Vertical range of the pelvis above the floor, from the 2nd to the 98th percentile."""
    joint_speed_max_degps: float
    """Fastest change of a parent-relative rotation between rows."""
    jerk_mean_mps3: float
    """Third difference of the joints' positions, mean over joints and rows."""
    jerk_max_mps3: float


def joints_of(motion: Motion, avatar: Avatar) -> tuple[Float64Array, Float64Array]:
    """Global joint rotations (T, 24, 3, 3) and positions [m] (T, 24, 3) in the z-up world."""
    G, P = np.empty((len(motion.root_m), 24, 3, 3)), np.empty((len(motion.root_m), 24, 3))
    roots, poses = motion.root_m.astype(np.float64), motion.pose_axis_angle.astype(np.float64)
    for row in range(len(roots)):
        fill_globals(roots[row], poses[row], avatar.joints_tpose_m, G[row], P[row])
    return G, P


def sole_points(G: Float64Array, P: Float64Array, skeleton: GaitSkeleton) -> Float64Array:
    """Heel (both edges), ball (both edges) and toe tip of both soles in the world [m], shape (T, 2, 5, 3)."""
    edges = (SOLE_HALF_WIDTH_M, -SOLE_HALF_WIDTH_M)
    heel = np.array([[x, -skeleton.sole_m, -skeleton.heel_m] for x in edges])
    points = np.empty((len(G), 2, 5, 3))
    for foot in range(2):
        tip = [0.0, -skeleton.toe_sole_m, skeleton.toe_m - skeleton.offsets_m[10 + foot, 2]]
        front = np.array([*([x, -skeleton.toe_sole_m, 0.0] for x in edges), tip])
        points[:, foot, :2] = P[:, None, 7 + foot] + np.einsum("tij,pj->tpi", G[:, 7 + foot], heel)
        points[:, foot, 2:] = P[:, None, 10 + foot] + np.einsum("tij,pj->tpi", G[:, 10 + foot], front)
    return points


def heights_above(points: Float64Array, floor: FloorMap) -> Float64Array:
    """Height [m] of world points above the floor, shape (..., 3) -> (...)."""
    flat = points.reshape(-1, 3)
    heights: Float64Array = (flat[:, 2] - floor.at_many(flat[:, :2])).reshape(points.shape[:-1])
    return heights


def bend_deg(P: Float64Array, upper: int, middle: int, lower: int) -> Float64Array:
    """Angle [deg] between two bones that meet at joint `middle`, shape (T,); 0 is straight."""
    a, b = P[:, middle] - P[:, upper], P[:, lower] - P[:, middle]
    cosine = np.sum(a * b, axis=1) / np.linalg.norm(a, axis=1) / np.linalg.norm(b, axis=1)
    angles: Float64Array = np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0)))
    return angles


def elbow_deg(G: Float64Array, P: Float64Array, side: int) -> Float64Array:
    """Bend of an elbow [deg] (side 0 left, 1 right), shape (T,); negative where the forearm points backwards."""
    forearm = P[:, 20 + side] - P[:, 18 + side]
    upper = P[:, 18 + side] - P[:, 16 + side]
    # In SMPL's T-pose both forearms bend forward about the vertical, towards z of the upper arm's frame.
    forward = G[:, 16 + side, :, 2]
    ahead = np.einsum("ti,ti->t", forearm, forward) / np.linalg.norm(forearm, axis=1)
    ahead = ahead - np.einsum("ti,ti->t", upper, forward) / np.linalg.norm(upper, axis=1)
    bends: Float64Array = np.sign(ahead) * bend_deg(P, 16 + side, 18 + side, 20 + side)
    return bends


def _joint_speed_degps(motion: Motion) -> Float64Array:
    R = matrix_from_axis_angle(motion.pose_axis_angle)
    trace = np.einsum("tjab,tjab->tj", R[:-1], R[1:])
    speeds: Float64Array = np.degrees(np.arccos(np.clip(0.5 * (trace - 1.0), -1.0, 1.0))) * motion.rate_hz
    return speeds


def _hover_mm(points: Float64Array, heights: Float64Array, rate_hz: int) -> float:
    lowest = np.take_along_axis(points, heights.argmin(axis=2)[:, :, None, None], axis=2)[:, :, 0]
    slow = np.linalg.norm(np.diff(lowest, axis=0), axis=-1) * rate_hz < STILL_MPS
    still = slow[2:] & slow[1:-1] & slow[:-2]
    return float(np.max(heights.min(axis=2)[1:-2], initial=0.0, where=still) * 1e3)


def measure(motion: Motion, avatar: Avatar, floor: FloorMap, trajectory_xy_m: Float64Array) -> MotionQuality:
    """Measure a motion.

    Args:
        motion: At least 4 rows.
        avatar: The body that the motion was made for.
        floor: The floor that it walks on.
        trajectory_xy_m: The ground positions it was asked to follow, shape (T, 2).
    """
    G, P = joints_of(motion, avatar)
    points = sole_points(G, P, skeleton_of(avatar))
    heights = heights_above(points, floor)
    held = (heights[1:] < CONTACT_HEIGHT_M) & (heights[:-1] < CONTACT_HEIGHT_M)
    slide = np.linalg.norm(np.diff(points, axis=0)[..., :2], axis=-1)[held] * motion.rate_hz * 100.0
    rows = min(len(trajectory_xy_m), len(motion.root_m))
    off = np.linalg.norm(motion.root_m[:rows, :2] - trajectory_xy_m[:rows], axis=1)
    knees = np.stack([bend_deg(P, 1 + side, 4 + side, 7 + side) for side in range(2)])
    low, high = np.percentile(heights_above(P[:, 0], floor), [2.0, 98.0])
    jerk = np.linalg.norm(np.diff(P, n=3, axis=0), axis=-1) * motion.rate_hz**3
    return MotionQuality(
        skate_mean_cmps=float(slide.mean()) if slide.size else 0.0,
        skate_max_cmps=float(slide.max()) if slide.size else 0.0,
        penetration_max_mm=float(max(-heights.min(), 0.0) * 1e3),
        hover_max_mm=_hover_mm(points, heights, motion.rate_hz),
        airborne_max_mm=float(heights.min(axis=(1, 2)).max() * 1e3),
        root_error_max_cm=float(off.max() * 100.0),
        knee_min_deg=float(knees.min()),
        knee_max_deg=float(knees.max()),
        elbow_min_deg=float(min(elbow_deg(G, P, 0).min(), elbow_deg(G, P, 1).min())),
        pelvis_oscillation_cm=float((high - low) * 100.0),
        joint_speed_max_degps=float(_joint_speed_degps(motion).max()),
        jerk_mean_mps3=float(jerk.mean()),
        jerk_max_mps3=float(jerk.max()),
    )


def cadence_per_min(motion: Motion, avatar: Avatar) -> float:
    """Steps per minute of a motion that walks from the first to the last row, from the ankles' forward peaks.

    Raises:
        ValueError: If there are fewer than two strides.
    """
    G, P = joints_of(motion, avatar)
    forward = G[:, 0, :, 2] * np.array([1.0, 1.0, 0.0])
    forward /= np.linalg.norm(forward, axis=1, keepdims=True)
    strides = []
    for ankle in (7, 8):
        reach = np.einsum("ti,ti->t", P[:, ankle] - P[:, 0], forward)
        peaks = [i for i in range(6, len(reach) - 6) if reach[i] == reach[i - 6 : i + 7].max()]
        fine = [i + 0.5 * (reach[i - 1] - reach[i + 1]) / (reach[i - 1] - 2 * reach[i] + reach[i + 1]) for i in peaks]
        if len(fine) < 3:
            raise ValueError(f"a cadence needs two strides or more, found {len(fine)} peaks of joint {ankle}.")
        strides.append((fine[-1] - fine[0]) / (len(fine) - 1) / motion.rate_hz)
    return 240.0 / float(strides[0] + strides[1])
