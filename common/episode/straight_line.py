"""The simplest navigator, a baseline: turn to the goal and drive straight at it, blind to map and humans."""

import math

from readygo.common.robot import RobotConfig

TURN_FIRST_RAD = 0.6
"""Beyond this bearing the robot turns in place [rad]."""
GAIN_PER_S = 3.0
"""Turn rate per bearing [1/s]."""


def straight_line_command(goal_xy_robot_m: tuple[float, float], robot: RobotConfig) -> tuple[float, float]:
    """Command that drives straight at the goal.

    Args:
        goal_xy_robot_m: Goal in the robot's frame (x forward, y left) [m].
        robot: Limits.

    Returns:
        v [m/s] and w [rad/s], within the limits of `robot`.
    """
    bearing_rad = math.atan2(goal_xy_robot_m[1], goal_xy_robot_m[0])
    w_radps = min(max(GAIN_PER_S * bearing_rad, -robot.w_max_radps), robot.w_max_radps)
    if abs(bearing_rad) >= TURN_FIRST_RAD:
        return 0.0, w_radps
    return robot.v_max_mps * (1.0 - abs(bearing_rad) / TURN_FIRST_RAD), w_radps
