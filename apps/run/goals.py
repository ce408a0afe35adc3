"""Where a robot stands when it has come to its goal, for images of what it sees there."""

import numpy as np
import numpy.typing as npt

from readygo.common.episode import EpisodeSimulation
from readygo.common.maps import OccupancyMap
from readygo.common.messages import Scenario
from readygo.common.policy import Policy
from readygo.services.renderer import Renderer, goal_view

Pose = tuple[float, float, float]


def goal_pose(scenario: Scenario, robot_map: OccupancyMap, radius_m: float) -> Pose:
    """How a robot stands that has come to its goal by the shortest way: x, y [m], yaw [rad].

    Args:
        scenario: Start and goal.
        robot_map: What blocks it.
        radius_m: Of the disc that ways are planned for [m].
    """
    # Workers that need no images of goals do without the evaluator.
    from readygo.services.evaluator.baselines.goal_field import arrival_yaw_rad

    goal_x, goal_y = scenario.goal_xy_m.tolist()
    start_x, start_y, _ = scenario.start_xyyaw.tolist()
    return goal_x, goal_y, arrival_yaw_rad(robot_map, radius_m, (start_x, start_y), (goal_x, goal_y))


def goal_seen(policy: Policy, renderer: Renderer, simulation: EpisodeSimulation) -> npt.NDArray[np.uint8] | None:
    """What a policy is shown of an episode's goal: sRGB, shape (H, W, 3); None where it does not want to know.

    Args:
        policy: Who drives.
        renderer: Of the scene, with the policy's camera.
        simulation: The episode.
    """
    if not policy.spec.wants_goal_image:
        return None
    scenario = simulation.scenario
    pose = goal_pose(scenario, simulation.robot_map, simulation.robot.planning_radius_m)
    return goal_view(renderer, scenario.episode, pose)
