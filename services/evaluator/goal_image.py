"""What a robot would see at its goal, with nobody about."""

import numpy as np
import numpy.typing as npt

from readygo.common.episode import EpisodeSimulation
from readygo.services.evaluator.baselines.goal_field import arrival_yaw_rad
from readygo.services.evaluator.eyes import Eyes


def goal_image(eyes: Eyes, simulation: EpisodeSimulation) -> npt.NDArray[np.uint8]:
    """The image that a robot takes that has come to its goal by the shortest way, sRGB, shape (H, W, 3).

    Args:
        eyes: Whose camera looks.
        simulation: The episode.
    """
    goal_x, goal_y = simulation.scenario.goal_xy_m.tolist()
    start_x, start_y, _ = simulation.scenario.start_xyyaw.tolist()
    radius_m = simulation.robot.planning_radius_m
    yaw_rad = arrival_yaw_rad(simulation.robot_map, radius_m, (start_x, start_y), (goal_x, goal_y))
    image: npt.NDArray[np.uint8] = eyes.look_from([(goal_x, goal_y, yaw_rad)], simulation)[0]
    return image
