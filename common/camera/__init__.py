"""The robot's camera: what is constant of it, and what a sensor varies from episode to episode."""

from readygo.common.camera.config import CameraConfig
from readygo.common.camera.sensor import SensorConfig

__all__ = ["CameraConfig", "SensorConfig"]
