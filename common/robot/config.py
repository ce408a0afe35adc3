"""`robot.toml`: the robot's footprint, limits and camera."""

import dataclasses
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

from readygo.common.camera.config import CameraConfig
from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """Footprint, limits and camera of a unicycle robot."""

    radius_m: float = 0.25
    """Radius of the robot's disc, which collisions are judged by [m]."""
    planning_radius_m: float = 0.30
    """Radius that maps are inflated by and paths are planned for [m]."""
    height_m: float = 0.6
    """What is lower than this blocks the robot [m]."""
    v_max_mps: float = 1.0
    """Largest speed; robots do not reverse [m/s]."""
    w_max_radps: float = 1.2
    """Largest yaw rate, either way [rad/s]."""
    a_max_mps2: float = 1.0
    """Largest change of the speed [m/s2]."""
    alpha_max_radps2: float = 3.0
    """Largest change of the yaw rate [rad/s2]."""
    camera: CameraConfig = field(default_factory=CameraConfig)
    """The camera on it."""

    def __post_init__(self) -> None:
        for name in ("radius_m", "height_m", "v_max_mps", "w_max_radps", "a_max_mps2", "alpha_max_radps2"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}.")
        if self.planning_radius_m < self.radius_m:
            raise ValueError(f"planning_radius_m {self.planning_radius_m} is below radius_m {self.radius_m}.")


def load_robot(path: str | Path, *, camera: CameraConfig | None = None) -> RobotConfig:
    """Read a `robot.toml`.

    Args:
        path: The file.
        camera: The camera of a file that has no section [camera]; the default one if this is None.

    Raises:
        ConfigError: If the file is missing, is not TOML, or holds an unknown or wrong value; it names the file.
    """
    # Numba takes a second to load, which those who import a robot's class need not wait for.
    from readygo.common.camera.lens import make_lens

    try:
        mapping = tomllib.loads(Path(path).read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"Robot file {path} cannot be read: {error}.") from error
    try:
        robot = section_from_mapping(RobotConfig, mapping)
        if camera is not None and "camera" not in mapping:
            robot = dataclasses.replace(robot, camera=camera)
        make_lens(robot.camera)
    except ConfigError as error:
        raise ConfigError(f"Robot file {path}: {error}") from error
    return robot
