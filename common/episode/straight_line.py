"""The simplest navigator: turn to the goal and drive straight at it, blind to map and people."""

import math

from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.robot import RobotConfig


class StraightLineController:
    """A baseline that every learned policy should beat."""

    def __init__(self, robot: RobotConfig, *, turn_first_rad: float = 0.6, gain_per_s: float = 3.0) -> None:
        self._robot = robot
        self._turn_first_rad = turn_first_rad
        self._gain_per_s = gain_per_s

    def act(self, simulation: EpisodeSimulation) -> tuple[float, float]:
        """Command (v [m/s], w [rad/s]) for the next step."""
        return straight_line_command(
            simulation.goal_xy_robot_m,
            self._robot,
            turn_first_rad=self._turn_first_rad,
            gain_per_s=self._gain_per_s,
        )


def straight_line_command(
    goal_xy_robot_m: tuple[float, float],
    robot: RobotConfig,
    *,
    turn_first_rad: float = 0.6,
    gain_per_s: float = 3.0,
) -> tuple[float, float]:
    """Command that drives straight at the goal.

    Args:
        goal_xy_robot_m: Goal in the robot's frame (x forward, y left) [m].
        robot: Limits.
        turn_first_rad: Beyond this bearing the robot turns in place [rad].
        gain_per_s: Turn rate per bearing [1/s].

    Returns:
        v [m/s] and w [rad/s], within the limits of `robot`.
    """
    bearing_rad = math.atan2(goal_xy_robot_m[1], goal_xy_robot_m[0])
    w_radps = min(max(gain_per_s * bearing_rad, -robot.w_max_radps), robot.w_max_radps)
    if abs(bearing_rad) >= turn_first_rad:
        return 0.0, w_radps
    return robot.v_max_mps * (1.0 - abs(bearing_rad) / turn_first_rad), w_radps
