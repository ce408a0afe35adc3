"""Where a person stands and faces in every frame, from keypoints alone: what the fit of poses begins with.

Of each frame, a person who stands upright is placed so that the keypoints fit best, for each of some headings, with the
sides as they are named and exchanged. Headings and sides over time are those that cost least with their changes:
people turn slowly, and shoulders and hips do not jump. The distance follows from the floor: at a scale s, pelvis p and
camera c satisfy p = c + s (p_1 - c), and p_z = s h.
"""

from dataclasses import dataclass, replace

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.services.reconstructor.avatars.keypoints import Keypoints

HEADINGS = 24
_TURN_RAD = 0.6
"""Changes of the heading cost their square in this unit."""
_BLUR, _ROBUST = 3.0, 4.0
"""No person stands quite upright: keypoints are off by so many times their deviation, and count little beyond the next
so many."""
_TRUST = {"elbow": 0.0, "wrist": 0.0, "knee": 0.2, "ankle": 0.2, "toe": 0.2, "heel": 0.2}
"""Weights of what moves, by the ends of names; the rest has 1."""
_TRUNK, _JUMP = ("shoulder", "_hip"), 5.0
"""What jumps by several times this many deviations from frame to frame is on the other side."""
_CHANGED, _SWAPPED = 2.0, 0.2
"""Exchanged sides cost so much at every change, and in every frame."""
_DEPTH_MIN_M, _BEHIND = 0.3, 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class KeypointViews:
    """Keypoints with the cameras that saw them; the world is metric, and its floor z = 0."""

    keypoints: Keypoints
    K_px: Float64Array
    """Intrinsics, shape (F, 3, 3)."""
    T_world_camera: Float64Array
    """Shape (F, 4, 4)."""
    times: Float64Array
    """When the images were taken, in usual spacings, shape (F,)."""

    def sigma_px(self, share: float) -> float:
        """Deviation of keypoints as a share of the height of the person in the image, at least a pixel."""
        spans = [
            np.ptp(uv[seen, 1])
            for uv, seen in zip(self.keypoints.uv_px, self.keypoints.seen, strict=True)
            if seen.any()
        ]
        return max(1.0, share * float(np.median(spans)))


@dataclass(frozen=True, kw_only=True, eq=False)
class Start:
    """Where a person stands in F frames."""

    root_m: Float64Array
    """Pelvises [m], shape (F, 3)."""
    heading_rad: Float64Array
    """Turns about the vertical axis, -pi to pi, shape (F,)."""
    scale: float
    """Size of the person relative to the standing one."""
    swapped: BoolArray
    """Frames whose left and right are exchanged, shape (F,)."""


def find_start(views: KeypointViews, standing_m: Float64Array, pelvis_height_m: float, sigma_px: float) -> Start:
    """Place a standing person in all frames.

    Args:
        views: What is seen.
        standing_m: Keypoints of a standing person relative to the pelvis at each heading [m], shape (HEADINGS, K, 3).
        pelvis_height_m: Height of their pelvis above the floor.
        sigma_px: Deviation of keypoints.
    """
    sides = (views, replace(views, keypoints=views.keypoints.with_swapped(np.array([[True]]))))
    placed = [_place(each, standing_m, _BLUR * sigma_px) for each in sides]
    costs = np.concatenate([placed[0][0], placed[1][0] + _SWAPPED], axis=1)
    states = np.arange(2 * HEADINGS)
    heading, swapped = 2.0 * np.pi * (states % HEADINGS) / HEADINGS, states >= HEADINGS
    turn = np.square(((heading[:, None] - heading + np.pi) % (2.0 * np.pi) - np.pi) / _TURN_RAD)
    stay, leave = _jumps(views.keypoints, sigma_px)
    turns = turn / np.square(np.diff(views.times))[:, None, None]
    change = turns + np.where(swapped[:, None] == swapped, stay[:, None, None], leave[:, None, None] + _CHANGED)
    path = cheapest_path(costs, change)
    place = np.concatenate([places for _, places in placed], axis=1)[np.arange(len(path)), path]
    eye = views.T_world_camera[:, :3, 3]
    scale = float(np.median(eye[:, 2] / np.maximum(pelvis_height_m - place[:, 2], 1e-3)))
    return Start(
        root_m=eye + scale * place,
        heading_rad=(heading[path] + np.pi) % (2.0 * np.pi) - np.pi,
        scale=scale,
        swapped=swapped[path],
    )


def cheapest_path(costs: Float64Array, change: Float64Array) -> Int64Array:
    """The states (F,) of rows whose costs (F, S) and changes (F - 1, S, S) are least in all.

    Source: Viterbi, Error bounds for convolutional codes, 1967.
    """
    total, before = costs[0], []
    for row, step in zip(costs[1:], change, strict=True):
        through = total[:, None] + step
        before.append(through.argmin(axis=0))
        total = row + through.min(axis=0)
    path = [int(total.argmin())]
    for best in reversed(before):
        path.append(int(best[path[-1]]))
    return np.array(path[::-1])


def _jumps(keypoints: Keypoints, sigma_px: float) -> tuple[Float64Array, Float64Array]:
    """How far the trunk moves from each frame to the next if sides stay, and if they are exchanged, (F - 1,) each."""
    trunk = np.array([name.endswith(_TRUNK) for name in keypoints.names])
    weight = (keypoints.confidence * keypoints.seen)[:, trunk]
    costs = []
    for after in (keypoints.uv_px[:, trunk], keypoints.uv_px[:, keypoints.mirror][:, trunk]):
        squares = np.square((after[1:] - keypoints.uv_px[:-1, trunk]) / (_JUMP * sigma_px)).sum(axis=2)
        costs.append((weight[1:] * weight[:-1] * squares / (1.0 + squares / _ROBUST**2)).sum(axis=1))
    return costs[0], costs[1]


def _place(views: KeypointViews, standing_m: Float64Array, sigma_px: float) -> tuple[Float64Array, Float64Array]:
    """Costs (F, HEADINGS) and pelvises relative to the camera (F, HEADINGS, 3) of a standing person.

    In camera coordinates q + t of a keypoint with ray (x, y, 1), t minimises |[1 0 -x; 0 1 -y] (q + t)|^2 in all.
    """
    points = views.keypoints
    trust = np.array([next((w for end, w in _TRUST.items() if name.endswith(end)), 1.0) for name in points.names])
    costs, places = np.empty((len(points), HEADINGS)), np.empty((len(points), HEADINGS, 3))
    for frame, (T, K) in enumerate(zip(views.T_world_camera, views.K_px, strict=True)):
        q, focal = standing_m @ T[:3, :3], K[[0, 1], [0, 1]]
        x, w = (points.uv_px[frame] - K[:2, 2]) / focal, points.confidence[frame] * points.seen[frame] * trust
        rows = np.concatenate([np.tile(np.eye(2), (len(x), 1, 1)), -x[..., None]], axis=2)
        N = np.einsum("k,kij,kil->jl", w, rows, rows) + 1e-9 * np.eye(3)
        t = -np.einsum("k,kij,kil,ykl->yj", w, rows, rows, q) @ np.linalg.inv(N)
        p = q + t[:, None]
        miss = (p[..., :2] / np.maximum(p[..., 2:], _DEPTH_MIN_M) - x) * focal / sigma_px
        squares = np.square(miss).sum(axis=2)
        costs[frame] = (w * squares / (1.0 + squares / _ROBUST**2)).sum(axis=1) + _BEHIND * (t[:, 2] < _DEPTH_MIN_M)
        places[frame] = t @ T[:3, :3].T
    return costs, places
