"""The robot: footprint, limits and camera, from the one file that maps, expert, renderer and policy read."""

from readygo.common.robot.config import CameraConfig, RobotConfig, load_robot, save_robot
from readygo.common.robot.kinematics import limit_command, step_unicycle

__all__ = ["CameraConfig", "RobotConfig", "limit_command", "load_robot", "save_robot", "step_unicycle"]
