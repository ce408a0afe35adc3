"""Where a person stands and faces in every frame, from keypoints alone: what the fit of poses begins with.

Of each frame, a person who stands upright is placed so that the keypoints fit best, for each of some headings, with the
sides as they are named and exchanged; the headings over time are then those that cost least with their changes. The
distance follows from the floor: at a scale s, pelvis p and camera c satisfy p = c + s (p_1 - c), and p_z = s h.
"""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.services.reconstructor.avatars.keypoints import Keypoints

HEADINGS = 24
_TURN_RAD, _CHANGE, _SWAPPED = 0.6, 2.0, 3.0
"""Changes of the heading cost their square in this unit; exchanged sides cost at every change, and in every frame."""
_BLUR, _ROBUST = 5.0, 2.0
"""Arms and legs move: keypoints are off by so many times their deviation, and count little beyond the next so many."""
_MOVING = ("elbow", "wrist")
_DEPTH_MIN_M, _BEHIND = 0.3, 100.0


@dataclass(frozen=True, kw_only=True, eq=False)
class KeypointViews:
    """Keypoints with the cameras that saw them; the world is metric, and its floor z = 0."""

    keypoints: Keypoints
    K_px: Float64Array
    """Intrinsics, shape (F, 3, 3)."""
    T_world_camera: Float64Array
    """Shape (F, 4, 4)."""

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
    costs, places = _place(views, standing_m, _BLUR * sigma_px)
    costs[:, 1] += _SWAPPED
    states = np.arange(2 * HEADINGS)
    heading, swapped = 2.0 * np.pi * (states % HEADINGS) / HEADINGS, states >= HEADINGS
    turn = (heading[:, None] - heading + np.pi) % (2.0 * np.pi) - np.pi
    change = np.square(turn / _TURN_RAD) + _CHANGE * (swapped[:, None] != swapped)
    path = cheapest_path(costs.reshape(len(costs), -1), change)
    place = places.reshape(len(costs), -1, 3)[np.arange(len(costs)), path]
    eye = views.T_world_camera[:, :3, 3]
    scale = float(np.median(eye[:, 2] / np.maximum(pelvis_height_m - place[:, 2], 1e-3)))
    return Start(
        root_m=eye + scale * place,
        heading_rad=(heading[path] + np.pi) % (2.0 * np.pi) - np.pi,
        scale=scale,
        swapped=swapped[path],
    )


def cheapest_path(costs: Float64Array, change: Float64Array) -> Int64Array:
    """The states of F rows whose costs (F, S) and changes (S, S) are least in all, shape (F,).

    Source: Viterbi, Error bounds for convolutional codes, 1967.
    """
    total, best_before = costs[0], []
    for row in costs[1:]:
        through = total[:, None] + change
        best_before.append(through.argmin(axis=0))
        total = row + through.min(axis=0)
    path = [int(total.argmin())]
    for best in reversed(best_before):
        path.append(int(best[path[-1]]))
    return np.array(path[::-1])


def _place(views: KeypointViews, standing_m: Float64Array, sigma_px: float) -> tuple[Float64Array, Float64Array]:
    """Costs (F, 2, HEADINGS) and places relative to the camera (F, 2, HEADINGS, 3); second come exchanged sides.

    In camera coordinates q + t of a keypoint with ray (x, y, 1), t minimises |[1 0 -x; 0 1 -y] (q + t)|^2 in all.
    """
    points = views.keypoints
    still = np.array([not name.endswith(_MOVING) for name in points.names])
    costs, places = np.empty((len(points), 2, HEADINGS)), np.empty((len(points), 2, HEADINGS, 3))
    for frame, (T, K) in enumerate(zip(views.T_world_camera, views.K_px, strict=True)):
        q, focal = standing_m @ T[:3, :3], K[[0, 1], [0, 1]]
        weights = points.confidence[frame] * points.seen[frame] * still
        for sides, order in enumerate((np.arange(len(still)), points.mirror)):
            x, w = (points.uv_px[frame][order] - K[:2, 2]) / focal, weights[order]
            rows = np.concatenate([np.tile(np.eye(2), (len(x), 1, 1)), -x[..., None]], axis=2)
            N = np.einsum("k,kij,kil->jl", w, rows, rows) + 1e-9 * np.eye(3)
            t = -np.einsum("k,kij,kil,ykl->yj", w, rows, rows, q) @ np.linalg.inv(N)
            p = q + t[:, None]
            miss = (p[..., :2] / np.maximum(p[..., 2:], _DEPTH_MIN_M) - x) * focal / sigma_px
            squares = np.square(miss).sum(axis=2)
            costs[frame, sides] = (w * squares / (1.0 + squares / _ROBUST**2)).sum(axis=1)
            costs[frame, sides] += _BEHIND * (t[:, 2] < _DEPTH_MIN_M)
            places[frame, sides] = t @ T[:3, :3].T
    return costs, places
