"""Keypoints of an avatar as a network might find them in a video: joints, and points on head and feet, with errors."""

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, UInt8Array
from readygo.common.avatars import Avatar, joint_transforms
from readygo.common.messages import Motion
from readygo.services.reconstructor import ANCHORS, HALPE26, Keypoints

HIDDEN_M = 0.13
"""A point so far behind the visible surface is hidden; joints lie up to this deep in the body [m]."""
SEEN_CONFIDENCE, HIDDEN_CONFIDENCE = 0.9, 0.35
_HIDDEN_NOISE = 2.0
"""Errors of hidden points relative to those of visible ones."""
_HEAD, _BALLS, _ANKLES = 15, (10, 11), (7, 8)
_BAND_M = 0.012


def canonical_keypoints(avatar: Avatar) -> tuple[list[int], Float64Array]:
    """The joint that each of `HALPE26` moves with, and its place in the canonical pose [m], shape (26, 3)."""
    surface = _surface_points(avatar)
    joints = [ANCHORS[name].joint for name in HALPE26]
    places = [surface.get(name, avatar.joints_canonical_m[joint]) for name, joint in zip(HALPE26, joints, strict=True)]
    return joints, np.stack(places).astype(np.float64)


def keypoints_in_world(avatar: Avatar, motion: Motion) -> Float64Array:
    """Where the keypoints are [m], shape (F, 26, 3)."""
    joints, places = canonical_keypoints(avatar)
    rows = []
    for root, pose in zip(motion.root_m, motion.pose_axis_angle, strict=True):
        A = joint_transforms(avatar, root, pose)[joints]
        rows.append((A[:, :, :3] @ places[..., None])[..., 0] + A[:, :, 3])
    return np.stack(rows)


def project_keypoints(
    points_m: Float64Array, T_world_camera: Float64Array, K_px: Float64Array, depth_m: Float32Array
) -> tuple[Float64Array, Float64Array]:
    """Pixels (K, 2) and confidences (K,) of points in one image; hidden ones and those outside have low confidences.

    Args:
        points_m: In the world, shape (K, 3).
        T_world_camera: Shape (4, 4).
        K_px: Shape (3, 3).
        depth_m: Depth of the person; inf beside it, shape (H, W).
    """
    p = (points_m - T_world_camera[:3, 3]) @ T_world_camera[:3, :3]
    uv = p[:, :2] / p[:, 2:] * K_px[[0, 1], [0, 1]] + K_px[:2, 2]
    height, width = depth_m.shape
    inside = (uv[:, 0] >= 0.0) & (uv[:, 0] < width) & (uv[:, 1] >= 0.0) & (uv[:, 1] < height)
    u, v = np.floor(np.where(inside[:, None], uv, 0.0)).astype(int).T
    visible = p[:, 2] < depth_m[v, u] + HIDDEN_M
    return uv, np.where(inside, np.where(visible, SEEN_CONFIDENCE, HIDDEN_CONFIDENCE), 0.0)


def disturb_keypoints(
    uv_px: Float64Array, confidence: Float64Array, noise_px: float, rng: np.random.Generator
) -> Keypoints:
    """Keypoints of F images with separate errors in each; hidden ones have larger errors.

    Args:
        uv_px: Shape (F, 26, 2).
        confidence: Shape (F, 26).
        noise_px: Standard deviation along each axis.
        rng: Randomness.
    """
    sigma = noise_px * np.where(confidence < SEEN_CONFIDENCE, _HIDDEN_NOISE, 1.0)
    noise = sigma[..., None] * rng.standard_normal(uv_px.shape)
    return Keypoints(names=HALPE26, uv_px=uv_px + noise, confidence=confidence)


def _surface_points(avatar: Avatar) -> dict[str, Float64Array]:
    """Points on head and feet by the names of keypoints, in the canonical pose [m]."""
    means = avatar.cloud.means_m.astype(np.float64)
    strongest = avatar.lbs_index[np.arange(len(means)), avatar.lbs_weight.argmax(axis=1)]
    head = means[strongest == _HEAD]
    nose = _extreme(head, (np.abs(head[:, 0]) < _BAND_M) & _below(head, 0.5), axis=2)
    top = _extreme(head, np.ones(len(head), dtype=bool), axis=1)
    points = {"nose": nose, "head": np.array([0.0, top[1], nose[2] - 0.11])}
    eye_y = nose[1] + 0.2 * (top[1] - nose[1])
    for side, sign in (("left", 1.0), ("right", -1.0)):
        beside = np.abs(head[:, 0] - sign * 0.031) < _BAND_M
        points[f"{side}_eye"] = _extreme(head, beside & (np.abs(head[:, 1] - eye_y) < _BAND_M), axis=2)
        ear = np.abs(head[:, 1] - eye_y) < _BAND_M
        points[f"{side}_ear"] = _extreme(head, ear & (np.abs(head[:, 2] - nose[2] + 0.12) < 0.03), 0, sign)
        points |= _foot_points(avatar, means, strongest, side, sign)
    return points


def _foot_points(
    avatar: Avatar,
    means: Float64Array,
    strongest: UInt8Array,
    side: str,
    sign: float,
) -> dict[str, Float64Array]:
    """Tips of big and small toe, and the heel, of the foot on one side."""
    row = 0 if sign > 0 else 1
    ball, ankle = avatar.joints_canonical_m[_BALLS[row]], avatar.joints_canonical_m[_ANKLES[row]]
    foot = means[np.isin(strongest, (_BALLS[row], _ANKLES[row])) & (means[:, 1] < 0.6 * ankle[1])]
    outwards = sign * (foot[:, 0] - ball[0])
    return {
        f"{side}_big_toe": _extreme(foot, np.abs(outwards + 0.02) < _BAND_M, axis=2),
        f"{side}_small_toe": _extreme(foot, np.abs(outwards - 0.035) < 0.5 * _BAND_M, axis=2),
        f"{side}_heel": _extreme(foot, np.abs(foot[:, 0] - ankle[0]) < 2 * _BAND_M, axis=2, sign=-1.0),
    }


def _below(points: Float64Array, share: float) -> BoolArray:
    low, high = points[:, 1].min(), points[:, 1].max()
    return np.asarray(points[:, 1] < low + share * (high - low))


def _extreme(points: Float64Array, among: BoolArray, axis: int, sign: float = 1.0) -> Float64Array:
    """The point that is farthest along an axis among some; among all where there are none."""
    chosen = points[among] if among.any() else points
    return np.asarray(chosen[(sign * chosen[:, axis]).argmax()])
