"""What the expert's compiled functions are handed, by name."""

from typing import NamedTuple

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int32Array, UInt8Array
from readygo.common.episode import EpisodeSimulation
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S


class State(NamedTuple):
    """A robot in motion."""

    x_m: float
    y_m: float
    yaw_rad: float
    v_mps: float
    w_radps: float


def state_of(simulation: EpisodeSimulation) -> State:
    """The robot's state in a simulation."""
    return State(simulation.x_m, simulation.y_m, simulation.yaw_rad, simulation.v_mps, simulation.w_radps)


class Limits(NamedTuple):
    """What a robot can do, and how long it holds commands."""

    v_max_mps: float
    w_max_radps: float
    a_max_mps2: float
    alpha_max_radps2: float
    v_min_mps: float = 0.0
    """Largest speed backwards, negative."""
    step_s: float = DT_S
    """Length of a step of its clock [s]."""
    held_steps: int = 1
    """Steps during which the command that is decided on now is held."""
    period_steps: int = 1
    """Steps during which each later command is held."""


def robot_limits(robot: RobotConfig) -> Limits:
    """The limits of a robot, for a command of one step."""
    return Limits(
        robot.v_max_mps,
        robot.w_max_radps,
        robot.a_max_mps2,
        robot.alpha_max_radps2,
        robot.v_min_mps,
        robot.clock.dt_s,
        period_steps=robot.clock.control_every,
    )


class Obstacles(NamedTuple):
    """A map of what blocks the robot."""

    occupied: BoolArray
    """True where something blocks the robot, shape (H, W)."""
    clearance_m: Float64Array
    """Distance of each cell's centre to an occupied one [m], shape (H, W)."""
    origin_x_m: float
    origin_y_m: float
    resolution_m: float


class Surroundings(NamedTuple):
    """What a run of the robot may meet."""

    obstacles: Obstacles
    radius_m: float
    """What a run keeps free around the robot's centre [m]."""
    humans_m: Float64Array
    """Where humans are expected after 1, 2, ... steps: x, y [m], shape (M, T, 2)."""
    contact_m: float
    """Distance of the centres of robot and human that counts as contact [m]."""
    doubt_mps: float
    """How fast the doubt about a human's position grows [m/s]."""


class HumansAhead(NamedTuple):
    """Humans in the way of a search in space and time, and how near the robot may come."""

    expected_m: Float64Array
    """Where they may be after 1, 2, ... steps [m], shape (M, T, 2)."""
    chances: Float64Array
    """How likely each row is, shape (M,)."""
    contact_m: float
    """Distance of the centres that counts as contact [m]."""
    widths_m: Float64Array
    """Free space beyond it that costs nothing [m], shape (M, T)."""
    weight: float
    """Cost per second just outside of contact, in metres at full speed; falls off to zero over the width."""
    step_s: float = DT_S
    """Length of a step [s]."""

    def seen_from(self, x_m: float, y_m: float) -> "HumansAhead":
        """The same humans with positions relative to another origin [m]."""
        return self._replace(expected_m=self.expected_m - np.array([x_m, y_m]))


class CostGrid(NamedTuple):
    """What driving over each cell costs, and how far it is to the goal."""

    factor: UInt8Array
    """Cost factors (see `readygo.common.episode.grid_search`), shape (H, W)."""
    to_goal: Int32Array
    """Way to the goal, UNITS_PER_CELL a cell, shape (H, W)."""
    resolution_m: float
    """Edge of a cell [m]."""


class Goal(NamedTuple):
    """Where a plan ends."""

    x_m: float
    y_m: float
    tolerance_m: float
    """So near it has arrived [m]."""
