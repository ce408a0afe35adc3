"""The robot: footprint, limits, rates and camera, from the one file that maps, expert, renderer and policy read."""

from readygo.common.camera import CameraConfig
from readygo.common.robot.clock import Clock
from readygo.common.robot.config import RobotConfig, load_robot
from readygo.common.robot.kinematics import limit_command, step_unicycle

__all__ = ["CameraConfig", "Clock", "RobotConfig", "limit_command", "load_robot", "step_unicycle"]
