"""The drives of a log: division into episodes, and conversion of odometry to samples at 20 Hz."""

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from readygo.apps.robot_logs.reader import LoggedPoses
from readygo.common.arrays import BoolArray, Float64Array, Int64Array
from readygo.common.frames import goal_in_robot_frame
from readygo.common.robot import Clock, RobotConfig, limit_command, step_unicycle
from readygo.common.robot.kinematics import DT_S, STEP_NS

GAP_NS = 500_000_000
"""Gap between images or poses that ends an episode [ns]."""
STILL_MPS, STILL_RADPS, STILL_S = 0.03, 0.05, 2.0
"""Speed [m/s], yaw rate [rad/s] and duration [s] of a standstill, which ends an episode at its goal."""
GAIN_X, GAIN_Y, GAIN_YAW = 2.0, 4.0, 3.0
"""Gains of the controller that tracks the odometry [1/s, 1/m^2, 1/s]."""
SHORTEST_S, SHORTEST_M = 2.0, 1.0
"""Smallest duration [s] and distance [m] of an episode; shorter ones are dropped."""


@dataclass(frozen=True, kw_only=True, eq=False)
class UnicycleDrive:
    """Motion of one episode as a unicycle model: each pose follows from the previous one and its command."""

    start_ns: int
    """Time of the first sample in the log [ns]."""
    xyyaw: Float64Array
    """Pose at each sample: x, y [m], yaw [rad], shape (T, 3)."""
    actions: Float64Array
    """Command over the next step: v [m/s], w [rad/s], shape (T, 2)."""
    clock: Clock
    """Clock of the samples."""
    drift_m: float
    """Largest distance from the odometry [m]."""

    @property
    def times_ns(self) -> Int64Array:
        """Time of each sample in the log [ns], shape (T,)."""
        return _ticks(self.start_ns, self.clock, len(self.xyyaw))


def spans(odometry: LoggedPoses, image_times_ns: Int64Array, episode_s: float) -> list[tuple[int, int]]:
    """First and last times of the episodes of a log [ns].

    Args:
        odometry: Poses of the robot.
        image_times_ns: Times of the images [ns], shape (N,).
        episode_s: Longest episode [s].
    """
    if len(image_times_ns) == 0:
        return []
    first = max(int(odometry.time_ns[0]), int(image_times_ns[0]))
    last = min(int(odometry.time_ns[-1]), int(image_times_ns[-1]))
    times_ns = np.arange(first, last + 1, STEP_NS)
    usable = _fresh(times_ns, odometry.time_ns) & _fresh(times_ns, image_times_ns) & ~_still(odometry, times_ns)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], usable, [False]]).astype(np.int8)))
    longest = round(episode_s / DT_S)
    found = []
    for begin, end in edges.reshape(-1, 2).tolist():
        for part in range(begin, end, longest):
            found.append((int(times_ns[part]), int(times_ns[min(part + longest, end) - 1])))
    return [span for span in found if _is_long_enough(odometry, *span)]


def drive_of(odometry: LoggedPoses, span: tuple[int, int], robot: RobotConfig) -> UnicycleDrive:
    """The motion of an episode: at every step the command that leads to the robot's next pose.

    A robot that slips or exceeds `robot`'s limits deviates from its odometry; `drift_m` is the largest deviation.
    """
    clock = robot.clock
    count = 1 + (span[1] - span[0]) * clock.rate_hz // 1_000_000_000
    times_ns = _ticks(span[0], clock, count)
    measured = _at(odometry, times_ns)
    pose: tuple[float, float, float] = tuple(measured[0].tolist())
    before: tuple[float, float] | None = None
    poses, actions = [], []
    for here, following in pairwise(measured):
        wished = _follow(pose, here, following, clock.dt_s)
        before = limit_command(*wished, *(before or wished), robot, clock.dt_s)
        poses.append(pose)
        actions.append(before)
        pose = step_unicycle(*pose, *before, clock.dt_s)
    xyyaw = np.array(poses)
    drift_m = np.linalg.norm(xyyaw[:, :2] - measured[:-1, :2], axis=1).max()
    return UnicycleDrive(start_ns=span[0], xyyaw=xyyaw, actions=np.array(actions), clock=clock, drift_m=float(drift_m))


def _follow(
    pose: tuple[float, float, float],
    here: Float64Array,
    following: Float64Array,
    dt_s: float,
) -> tuple[float, float]:
    """The command of a controller that tracks the odometry: v [m/s], w [rad/s].

    Source: Kanayama et al., "A stable tracking control method for an autonomous mobile robot", ICRA 1990, equation 7.
    """
    turn_rad = float(following[2] - here[2])
    heading = float(here[2]) + turn_rad / 2
    v = float((following[:2] - here[:2]) @ (math.cos(heading), math.sin(heading))) / dt_s
    ahead_m, left_m = goal_in_robot_frame(*pose, (float(here[0]), float(here[1])))
    off_rad = float(here[2]) - pose[2]
    return v * math.cos(off_rad) + GAIN_X * ahead_m, turn_rad / dt_s + v * GAIN_Y * left_m + GAIN_YAW * off_rad


def _ticks(first_ns: int, clock: Clock, count: int) -> Int64Array:
    return first_ns + np.array([clock.time_ns(step) for step in range(count)], np.int64)


def _at(odometry: LoggedPoses, times_ns: Int64Array) -> Float64Array:
    """Poses at times, interpolated between the measured ones, shape (T, 3)."""
    columns = [np.interp(times_ns, odometry.time_ns, column) for column in odometry.xyyaw.T]
    return np.stack(columns, axis=1)


def _fresh(times_ns: Int64Array, known_ns: Int64Array) -> BoolArray:
    """True at times within `GAP_NS` after a message whose successor follows within `GAP_NS`, shape (T,)."""
    place = np.searchsorted(known_ns, times_ns, side="right") - 1
    following = known_ns[np.minimum(place + 1, len(known_ns) - 1)]
    return (place >= 0) & (times_ns - known_ns[place] <= GAP_NS) & (following - known_ns[place] <= GAP_NS)


def _still(odometry: LoggedPoses, times_ns: Int64Array) -> BoolArray:
    """True at times within a standstill of at least `STILL_S`, shape (T,)."""
    poses = _at(odometry, times_ns)
    speed = np.linalg.norm(np.gradient(poses[:, :2], DT_S, axis=0), axis=1) if len(poses) > 1 else np.zeros(len(poses))
    turning = np.abs(np.gradient(poses[:, 2], DT_S)) if len(poses) > 1 else np.zeros(len(poses))
    slow = (speed < STILL_MPS) & (turning < STILL_RADPS)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], slow, [False]]).astype(np.int8))).reshape(-1, 2)
    still = np.zeros(len(times_ns), np.bool_)
    for begin, end in edges.tolist():
        still[begin:end] = (end - begin) * DT_S >= STILL_S
    return still


def _is_long_enough(odometry: LoggedPoses, first_ns: int, last_ns: int) -> bool:
    places = _at(odometry, np.arange(first_ns, last_ns + 1, STEP_NS))[:, :2]
    way_m = np.linalg.norm(np.diff(places, axis=0), axis=1).sum()
    return (last_ns - first_ns) / 1e9 >= SHORTEST_S and bool(way_m >= SHORTEST_M)
