"""How a robot stands that has arrived at its goal, for images of what it sees there."""

import math

import numpy as np

from readygo.common.episode.grid_search import FREE, GridSearch, taut_path_m
from readygo.common.maps import OccupancyMap, clearance_m
from readygo.common.messages import Scenario


def goal_pose(scenario: Scenario, robot_map: OccupancyMap, radius_m: float) -> tuple[float, float, float]:
    """Pose of a robot that has come to its goal by the shortest path: x, y [m], yaw [rad].

    Args:
        scenario: Start and goal.
        robot_map: What blocks the robot.
        radius_m: Radius of the disc that paths are planned for [m].
    """
    goal_x, goal_y = scenario.goal_xy_m.tolist()
    start_x, start_y, _ = scenario.start_xyyaw.tolist()
    return goal_x, goal_y, arrival_yaw_rad(robot_map, radius_m, (start_x, start_y), (goal_x, goal_y))


def arrival_yaw_rad(
    occupancy: OccupancyMap, radius_m: float, start_xy_m: tuple[float, float], goal_xy_m: tuple[float, float]
) -> float:
    """Heading in which the shortest way comes to a goal [rad]; that of the straight line where there is no way.

    Args:
        occupancy: What blocks.
        radius_m: Radius of the disc that moves [m].
        start_xy_m: Where from.
        goal_xy_m: Where to.
    """
    frame = occupancy.frame
    factor = np.where(clearance_m(occupancy) > radius_m, np.uint8(FREE), np.uint8(0))
    start, goal = frame.cell(*start_xy_m), frame.cell(*goal_xy_m)
    factor[start] = factor[goal] = FREE
    cells = GridSearch(factor.shape).path(factor, start, goal)
    (ax, ay), (bx, by) = start_xy_m, goal_xy_m
    if cells is not None and len(cells) > 1:
        (ax, ay), (bx, by) = taut_path_m(cells, factor, frame)[-2:].tolist()
    return math.atan2(by - ay, bx - ax)
