"""What camera and people do between the rows of an episode."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.camera import CameraConfig
from readygo.common.frames.turning import turn_between
from readygo.common.maps import FloorMap
from readygo.common.messages import HumanMotion
from readygo.common.rasterizer.interface import PosedHuman

Floats = npt.NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Moment:
    """What there is to draw at one time."""

    T_world_camera: Floats
    """Camera pose, OpenCV axes, shape (4, 4)."""
    humans: tuple[HumanMotion, ...]
    step: float
    """Simulation step at which the humans are drawn; it need not be whole."""

    def equals(self, other: "Moment") -> bool:
        """True if both, moments of the same people, give the same image."""
        if not np.array_equal(self.T_world_camera, other.T_world_camera):
            return False
        pairs = zip(posed(self.humans, self.step), posed(other.humans, other.step), strict=True)
        return all(one.equals(two) for one, two in pairs)


@dataclass(frozen=True, kw_only=True, eq=False)
class Timeline:
    """Camera and people of an episode at any time; before the first row and after the last one all stand still."""

    xyyaw: Floats
    """Robot at each step from `first_step` on: x [m], y [m], yaw [rad] (not wrapped), shape (T, 3)."""
    humans: tuple[HumanMotion, ...]
    floor: FloorMap
    camera: CameraConfig
    first_step: int = 0

    def at(self, step: float) -> Moment:
        """The moment at a step, which need not be whole: the robot drives an arc between rows."""
        row, share = _row_and_share(step, self.first_step + len(self.xyyaw))
        row, share = (row - self.first_step, share) if row >= self.first_step else (0, 0.0)
        pose = self.xyyaw[row] if share == 0.0 else arc(self.xyyaw[row], self.xyyaw[row + 1], share)
        x_m, y_m, yaw_rad = (float(value) for value in pose)
        T_world_camera = self.camera.T_world_camera(x_m, y_m, yaw_rad, self.floor.at(x_m, y_m))
        return Moment(T_world_camera=T_world_camera, humans=self.humans, step=step)


def posed(humans: Sequence[HumanMotion], step: float) -> tuple[PosedHuman, ...]:
    """People at a step: between rows the root moves straight and every joint turns about one axis."""
    return tuple(_posed(human, step) for human in humans)


def _posed(human: HumanMotion, step: float) -> PosedHuman:
    root_m, pose = human.motion.root_m, human.motion.pose_axis_angle
    row, share = _row_and_share(step, len(root_m))
    if share == 0.0:
        return PosedHuman(avatar=human.avatar, root_m=root_m[row], pose_axis_angle=pose[row])
    between = root_m[row] + np.float32(share) * (root_m[row + 1] - root_m[row])
    turned = np.empty((24, 3), dtype=np.float32)
    turn_between(pose[row], pose[row + 1], share, turned)
    return PosedHuman(avatar=human.avatar, root_m=between, pose_axis_angle=turned)


def _row_and_share(step: float, count: int) -> tuple[int, float]:
    """The row before a step and the share of the way to the next one."""
    if step >= count - 1:
        return count - 1, 0.0
    row = max(math.floor(step), 0)
    return row, max(step - row, 0.0)


def arc(first: Floats, last: Floats, share: float) -> tuple[float, float, float]:
    """Pose (x, y, yaw) after a share of the constant twist that carries one planar pose to another.

    Between two samples of a unicycle that keeps its command this is the arc that it drives.
    Source: Lynch & Park, Modern Robotics, 2017, section 3.3.3 (exponential coordinates), in the plane.
    """
    x0, y0, yaw0 = (float(value) for value in first)
    x1, y1, yaw1 = (float(value) for value in last)
    half = 0.5 * (yaw1 - yaw0)
    # The chord of a part of the arc is to the whole chord as the sines of the half angles, and turned between them.
    part = share * half
    length = math.sin(part) / math.sin(half) if abs(half) > 1e-9 else share
    turn = part - half
    dx, dy = length * (x1 - x0), length * (y1 - y0)
    c, s = math.cos(turn), math.sin(turn)
    return x0 + c * dx - s * dy, y0 + s * dx + c * dy, yaw0 + 2.0 * part
