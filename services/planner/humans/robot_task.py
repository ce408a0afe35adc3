"""The robot's task in a scenario, and its expected positions without humans."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.humans.polyline import at_lengths

Point = tuple[float, float]

SPACING_M = 0.05
"""Distance of the points of a way, or a little less [m]."""


@dataclass(frozen=True, kw_only=True, eq=False)
class RobotTask:
    """Where the robot goes, and the taut way it is expected to take."""

    start_m: Point
    goal_m: Point
    way_m: Float64Array
    """Evenly spaced points from start to goal [m], shape (N, 2)."""
    length_m: float
    """Length of the way [m]."""

    @cached_property
    def _points(self) -> list[Point]:
        return [(x, y) for x, y in self.way_m.tolist()]

    def at(self, fraction: float) -> tuple[Point, Point]:
        """Point at a fraction of the way [m], and the unit direction there, over half a metre."""
        points = self._points
        last = len(points) - 1
        k = min(int(fraction * last), last)
        (ax, ay), (bx, by) = points[max(0, k - 5)], points[min(last, k + 5)]
        dx, dy = bx - ax, by - ay
        norm = math.hypot(dx, dy)
        return points[k], (dx / norm, dy / norm)


@dataclass(frozen=True, kw_only=True)
class ExpectedDrive:
    """How a robot drives its path without humans: full stop at first, then one speed."""

    speed_mps: float
    getting_going_s: float
    """Time that speeding up costs [s]."""

    @classmethod
    def of(cls, robot: RobotConfig, speed_fraction: float) -> "ExpectedDrive":
        """The drive of a robot at a share of its top speed."""
        return cls(speed_mps=speed_fraction * robot.v_max_mps, getting_going_s=0.5 * robot.v_max_mps / robot.a_max_mps2)

    def time_s(self, along_m: float) -> float:
        """When the robot is a distance along its way [s]."""
        return along_m / self.speed_mps + self.getting_going_s

    def along_m(self, time_s: float) -> float:
        """How far along its way the robot is, without an end to the way [m]."""
        return max(0.0, (time_s - self.getting_going_s) * self.speed_mps)

    def rows(self, task: RobotTask, count: int) -> Float64Array:
        """Where the robot is at the first `count` steps; at the goal it stays [m], shape (count, 2)."""
        return at_lengths(task.way_m, self._along(task, count))

    def directions(self, task: RobotTask, count: int) -> Float64Array:
        """Where the way leads at the first `count` steps, over half a metre; not normalised, shape (count, 2)."""
        along = self._along(task, count)
        ahead, behind = np.minimum(along + 0.25, task.length_m), np.maximum(along - 0.25, 0.0)
        return at_lengths(task.way_m, ahead) - at_lengths(task.way_m, behind)

    def _along(self, task: RobotTask, count: int) -> Float64Array:
        along = (np.arange(count, dtype=np.float64) * DT_S - self.getting_going_s) * self.speed_mps
        clipped: Float64Array = np.clip(along, 0.0, task.length_m).astype(np.float64, copy=False)
        return clipped


def rotate_left(direction: Point, angle_rad: float) -> Point:
    """A direction, turned to the left."""
    c, s = math.cos(angle_rad), math.sin(angle_rad)
    return c * direction[0] - s * direction[1], s * direction[0] + c * direction[1]


def offset_point(point_m: Point, direction: Point, forward_m: float, left_m: float = 0.0) -> Point:
    """A point some way ahead in a (unit) direction, and to the left of it [m]."""
    (x, y), (u, v) = point_m, direction
    return x + forward_m * u - left_m * v, y + forward_m * v + left_m * u


def apart_m(a: Point, b: Point) -> float:
    """Distance of two points [m]."""
    return math.hypot(b[0] - a[0], b[1] - a[1])
