"""The robot and the avatars of the renderer's tests."""

import functools

from readygo.common.avatars import Avatar, load_avatars
from readygo.common.robot import CameraConfig, RobotConfig

ROBOT = RobotConfig(camera=CameraConfig(height_px=48, width_px=80))


@functools.cache
def wearers() -> dict[str, Avatar]:
    loaded = load_avatars()
    return {name: loaded[name] for name in sorted(loaded)[:2]}
