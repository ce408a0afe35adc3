"""`robot.toml`: the robot's footprint, limits and camera."""

import math
import tomllib
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import numpy.typing as npt

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.errors import ConfigError


@dataclass(frozen=True, kw_only=True)
class CameraConfig:
    """A level pinhole camera on the robot, looking along the robot's x axis."""

    height_px: int = 144
    """Image height."""
    width_px: int = 256
    """Image width."""
    horizontal_fov_deg: float = 100.0
    """What the image spans between its left and right edges."""
    mount_height_m: float = 0.5
    """Height of the camera above the local floor [m]."""

    def __post_init__(self) -> None:
        if not (8 <= self.height_px <= 4095 and 8 <= self.width_px <= 4095):
            raise ValueError(f"image size must be 8..4095 px, got {self.height_px}x{self.width_px}.")
        if not 10.0 <= self.horizontal_fov_deg <= 170.0:
            raise ValueError(f"horizontal_fov_deg must be 10..170, got {self.horizontal_fov_deg}.")

    @property
    def K_px(self) -> npt.NDArray[np.float64]:
        """Intrinsics [px], shape (3, 3), pixel centres at +0.5, square pixels, centred."""
        focal_px = 0.5 * self.width_px / math.tan(math.radians(self.horizontal_fov_deg) / 2)
        return np.array([[focal_px, 0.0, self.width_px / 2], [0.0, focal_px, self.height_px / 2], [0.0, 0.0, 1.0]])

    def T_world_camera(self, x_m: float, y_m: float, yaw_rad: float, floor_m: float) -> npt.NDArray[np.float64]:
        """Pose of the camera of a robot on the floor, OpenCV axes, shape (4, 4).

        Args:
            x_m: The robot's centre in the world [m].
            y_m: As `x_m`.
            yaw_rad: Its heading from the world's x axis to the left [rad].
            floor_m: Height of the floor below it [m].
        """
        c, s = math.cos(yaw_rad), math.sin(yaw_rad)
        T = np.eye(4)
        T[:3, 0] = (s, -c, 0.0)
        T[:3, 1] = (0.0, 0.0, -1.0)
        T[:3, 2] = (c, s, 0.0)
        T[:3, 3] = (x_m, y_m, floor_m + self.mount_height_m)
        return T


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


def load_robot(path: str | Path) -> RobotConfig:
    """Read a `robot.toml`.

    Args:
        path: The file.

    Raises:
        ConfigError: If the file is missing, is not TOML, or holds an unknown or wrong value.
    """
    try:
        mapping = tomllib.loads(Path(path).read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise ConfigError(f"Robot file {path} cannot be read: {error}.") from error
    return section_from_mapping(RobotConfig, mapping)


def save_robot(robot: RobotConfig, path: str | Path) -> None:
    """Write a `robot.toml` that `load_robot` reads back."""
    mapping = section_to_mapping(robot)
    camera = mapping.pop("camera")
    lines = [f"{key} = {value!r}" for key, value in mapping.items()]
    lines += ["", "[camera]", *(f"{key} = {value!r}" for key, value in camera.items())]
    Path(path).write_text("\n".join(lines) + "\n")
