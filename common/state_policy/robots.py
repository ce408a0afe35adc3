"""Which robots a state policy drives: it sees no images, so of the cameras only the view matters, not the pixels."""

import dataclasses

import numpy as np

from readygo.common.camera import CameraConfig
from readygo.common.config import section_differences
from readygo.common.robot import RobotConfig
from readygo.common.state_simulation.world import camera_views


def robot_difference(trained: RobotConfig, robot: RobotConfig) -> str:
    """What keeps a state policy from driving a robot; empty if nothing does.

    Args:
        trained: The robot that it was trained for.
        robot: The robot that it shall drive, without ranges.
    """
    if different := section_differences(_without_cameras(trained), _without_cameras(robot)):
        key, known, asked = different[0]
        return f"{key} is {known}, here {asked}"
    ours, theirs = camera_views(trained), camera_views(robot)
    return "" if ours.shape == theirs.shape and np.allclose(ours, theirs) else "its cameras show something else"


def _without_cameras(robot: RobotConfig) -> RobotConfig:
    return dataclasses.replace(robot, camera=CameraConfig(), camera_name=RobotConfig.camera_name, cameras={})
