"""Replays a motion at another pace and along another path than planned, for humans who yield while they walk.

The gait depends on the walked distance: a slower human takes the same steps later. Below a slow walk the figure blends
into its standing pose. Feet follow the path, but not to the millimetre of the ground: sideways steps slide.
"""

import math

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array
from readygo.common.frames.rotations import axis_angle_from_matrix, matrix_from_axis_angle, wrap_angle
from readygo.common.maps import FloorMap
from readygo.common.messages import Motion
from readygo.common.robot.kinematics import DT_S

STANDING_MPS, WALKING_MPS = 0.05, 0.5
"""Slower ones stand, faster ones walk; between, the pose is mixed."""
BODY_TURN_RADPS = 3.0
"""Fastest turn of a body [rad/s]."""
_IDLE_M = 0.5
"""A motion with a shorter path is that of a standing human: it advances with time [m]."""
_LOOP_M = (0.8, 2.2)
"""Length of the piece that is walked again by those who have farther to go than was drawn [m]."""
_END_M = 0.7
"""The last steps into the stand, which are not walked again [m]."""


class RetimedWalk:
    """One human's motion, step by step, wherever they go."""

    def __init__(self, motion: Motion, floor: FloorMap) -> None:
        """Begin at the motion's first row.

        Args:
            motion: As it was drawn.
            floor: Height of the floor.
        """
        self._motion, self._floor = motion, floor
        root_m = motion.root_m.astype(np.float64)
        steps_m = np.hypot(*np.diff(root_m[:, :2], axis=0).T)
        self._way_m = np.concatenate([[0.0], np.cumsum(steps_m)])
        self._height_m = root_m[:, 2] - floor.at_many(root_m[:, :2])
        self._R_root = matrix_from_axis_angle(motion.pose_axis_angle[:, 0].astype(np.float64))
        self._facing = np.arctan2(-self._R_root[:, 2, 2], self._R_root[:, 0, 2])
        self._loop = _loop_rows(self._way_m, motion.pose_axis_angle)
        self._row = 0
        self._gone_m = 0.0
        self._yaw_rad = float(self._facing[0])

    def advance(self, xy_m: Float64Array, velocity_mps: Float64Array) -> tuple[Float64Array, Float64Array]:
        """The pose of the next step.

        Args:
            xy_m: Where the human is then [m], shape (2,).
            velocity_mps: How it came there [m/s], shape (2,).

        Returns:
            Pelvis in the z-up world [m], shape (3,), and parent-relative rotations [rad], shape (24, 3).
        """
        speed = math.hypot(*velocity_mps.tolist())
        self._go_on(speed * DT_S)
        if speed > STANDING_MPS:
            off = float(wrap_angle(math.atan2(velocity_mps[1], velocity_mps[0]) - self._yaw_rad))
            most = BODY_TURN_RADPS * DT_S
            self._yaw_rad += min(max(off, -most), most)
        standing = 0.0 if self._idles else 1.0 - min(max(speed - STANDING_MPS, 0.0) / (WALKING_MPS - STANDING_MPS), 1.0)
        height_m = (1 - standing) * self._height_m[self._row] + standing * self._height_m[-1]
        root = np.array([*xy_m.tolist(), self._floor.at(float(xy_m[0]), float(xy_m[1])) + height_m])
        return root, self._pose(standing)

    @property
    def _idles(self) -> bool:
        return bool(self._way_m[-1] < _IDLE_M)

    def _go_on(self, distance_m: float) -> None:
        """To the row at which the way walked is longer by a distance."""
        if self._idles:
            self._row = min(self._row + 1, len(self._way_m) - 1)
            return
        self._gone_m += distance_m
        if self._loop is not None and self._gone_m > self._way_m[self._loop[1]]:
            self._gone_m -= float(self._way_m[self._loop[1]] - self._way_m[self._loop[0]])
        row = min(int(np.searchsorted(self._way_m, self._gone_m)), len(self._way_m) - 1)
        before = max(row - 1, 0)
        nearer = self._gone_m - self._way_m[before] < self._way_m[row] - self._gone_m
        self._row = before if nearer else row

    def _pose(self, standing: float) -> Float64Array:
        walked, stood = (self._motion.pose_axis_angle[row].astype(np.float64) for row in (self._row, -1))
        pose: Float64Array = (1 - standing) * walked + standing * stood
        tilt = (1 - standing) * self._tilt(self._row) + standing * self._tilt(-1)
        pose[0] = axis_angle_from_matrix(_turn(self._yaw_rad) @ matrix_from_axis_angle(tilt))
        return pose

    def _tilt(self, row: int) -> Float64Array:
        """The body's rotation without its heading."""
        tilt: Float64Array = axis_angle_from_matrix(_turn(-float(self._facing[row])) @ self._R_root[row])
        return tilt


def _turn(yaw_rad: float) -> Float64Array:
    """A turn about the vertical, SMPL's y axis."""
    return matrix_from_axis_angle(np.array([0.0, yaw_rad, 0.0]))


def _loop_rows(way_m: Float64Array, poses: Float32Array) -> tuple[int, int] | None:
    """First and last row of a piece that ends in the pose in which it begins; None where the way is too short."""
    last = int(np.searchsorted(way_m, way_m[-1] - _END_M))
    first = np.flatnonzero((way_m >= way_m[last] - _LOOP_M[1]) & (way_m <= way_m[last] - _LOOP_M[0]))
    if len(first) == 0:
        return None
    # Joints below the root, whose heading changes along the way.
    off = np.abs(poses[first, 1:] - poses[last, 1:]).sum(axis=(1, 2))
    return int(first[off.argmin()]), last
