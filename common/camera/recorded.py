"""Settings that were recorded before the camera was one section."""

from collections.abc import Mapping
from typing import Any

_NOT_THE_CAMERAS = ("ranges", "sub_frames")


def with_whole_camera(config: Mapping[str, Any]) -> dict[str, Any]:
    """A run's recorded sections as they are today.

    Lens, light and shutter used to stand in `[renderer.sensor]`, with what varies in a table `ranges` below them and
    the number of sub-frames beside them. A value with a range was not used: the middle of the range is now the camera's
    (`SensorConfig.middle`). Sections of today come back unchanged.
    """
    renderer = config.get("renderer", {})
    sensor = renderer.get("sensor", {}) if isinstance(renderer, Mapping) else {}
    if not isinstance(sensor, Mapping) or "ranges" not in sensor:
        return dict(config)
    robot = config.get("robot", {})
    constants = {name: value for name, value in sensor.items() if name not in _NOT_THE_CAMERAS}
    constants |= {name: 0.5 * (ends[0] + ends[1]) for name, ends in sensor["ranges"].items() if ends}
    return {
        **config,
        "robot": {**robot, "camera": {**robot.get("camera", {}), **constants}},
        "renderer": {**renderer, "sensor": sensor["ranges"], "sub_frames": sensor["sub_frames"]},
    }
