"""How a robot stands that has arrived at its goal, for images of what it sees there."""

import math

from readygo.common.episode.grid_search import shortest_path_m
from readygo.common.maps import OccupancyMap
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
    points_m = shortest_path_m(occupancy, radius_m, start_xy_m, goal_xy_m)
    (ax, ay), (bx, by) = start_xy_m, goal_xy_m
    if points_m is not None and len(points_m) > 1:
        (ax, ay), (bx, by) = points_m[-2:].tolist()
    return math.atan2(by - ay, bx - ax)
