"""`robot.toml`: the robot's footprint, limits, rates and cameras."""

import dataclasses
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from readygo.common.camera.config import CameraConfig
from readygo.common.config import section_from_mapping
from readygo.common.documents import read_toml
from readygo.common.errors import ConfigError, cause
from readygo.common.robot.clock import LOWEST_HZ, Clock, make_clock
from readygo.common.robot.ranges import OF_CAMERA, RobotRanges

CAMERAS_MAX = 7
"""Most cameras besides the first one: each has separate channels in a shard."""


@dataclass(frozen=True, kw_only=True)
class RobotConfig:
    """Footprint, limits, rates and cameras of a unicycle robot."""

    radius_m: float = 0.25
    """Radius of the robot's disc, which collisions are judged by [m]."""
    planning_radius_m: float = 0.30
    """Radius that maps are inflated by and paths are planned for [m]."""
    height_m: float = 0.6
    """What is lower than this blocks the robot [m]."""
    v_max_mps: float = 1.0
    """Largest speed [m/s]."""
    v_min_mps: float = 0.0
    """Largest speed backwards, as a negative number; 0 for a robot that does not reverse [m/s]."""
    w_max_radps: float = 1.2
    """Largest yaw rate, either way [rad/s]."""
    a_max_mps2: float = 1.0
    """Largest change of the speed [m/s2]."""
    alpha_max_radps2: float = 3.0
    """Largest change of the yaw rate [rad/s2]."""
    control_hz: int = LOWEST_HZ
    """How often it is commanded; in between the command is held [Hz]."""
    camera_hz: int = LOWEST_HZ
    """How often its camera takes an image [Hz]."""
    camera: CameraConfig = field(default_factory=CameraConfig)
    """The camera on it; the first one of several, with the topics of a single one."""
    camera_name: str = "front"
    """What the first camera is called among several."""
    cameras: Mapping[str, CameraConfig] = field(default_factory=dict, hash=False)
    """Further cameras by name."""
    ranges: RobotRanges = field(default_factory=RobotRanges)
    """What differs from episode to episode, for a policy that shall drive several robots of one camera."""

    def __post_init__(self) -> None:
        for name in ("radius_m", "height_m", "v_max_mps", "w_max_radps", "a_max_mps2", "alpha_max_radps2"):
            if not getattr(self, name) > 0:
                raise ValueError(f"{name} must be positive, got {getattr(self, name)}.")
        if self.planning_radius_m < self.radius_m:
            raise ValueError(f"planning_radius_m {self.planning_radius_m} is below radius_m {self.radius_m}.")
        if not -self.v_max_mps <= self.v_min_mps <= 0:
            raise ValueError(
                f"v_min_mps is the largest speed backwards: -{self.v_max_mps:g} (v_max_mps) to 0, got "
                f"{self.v_min_mps:g}."
            )
        make_clock(self.control_hz, self.camera_hz)
        self._check_cameras()
        self._check_ranges()

    def _check_ranges(self) -> None:
        camera = self.camera
        if self.ranges.varies and self.cameras:
            raise ValueError("ranges are for robots of one camera: leave out either [ranges] or the further cameras.")
        if self.ranges.horizontal_fov_deg and (camera.horizontal_fov_deg is None or camera.distortion != "none"):
            raise ValueError(
                "ranges.horizontal_fov_deg needs a camera without distortion that sets horizontal_fov_deg itself, "
                "not fx_px."
            )
        try:
            self.ranges.check(lambda name, value: self.with_values({name: value}))
        except ValueError as error:
            raise ValueError(f"ranges.{error}") from error

    def with_values(self, values: Mapping[str, float]) -> "RobotConfig":
        """One of the robots of its ranges; the robot itself if there are no values.

        Args:
            values: By the names of `RobotRanges`, one for each that has a range.

        Raises:
            ValueError: If no robot has such a value.
        """
        if not values:
            return self
        own: dict[str, float] = {name: value for name, value in values.items() if name not in OF_CAMERA}
        if "radius_m" in own:
            own["planning_radius_m"] = own["radius_m"] + (self.planning_radius_m - self.radius_m)
        if "v_max_mps" in own:
            own["v_min_mps"] = self.v_min_mps / self.v_max_mps * own["v_max_mps"]
        seen: dict[str, Any] = {name: value for name, value in values.items() if name in OF_CAMERA}
        camera = dataclasses.replace(self.camera, **seen)
        return dataclasses.replace(self, **own, camera=camera, ranges=RobotRanges())  # type: ignore[arg-type]

    @property
    def widest(self) -> "RobotConfig":
        """The one of its robots that needs most room."""
        ends = self.ranges.radius_m
        return self.with_values({"radius_m": ends[1]}) if ends else self

    def _check_cameras(self) -> None:
        if self.camera_name in self.cameras:
            raise ValueError(
                f"two cameras are called {self.camera_name!r}: [camera] is, unless camera_name gives it another name."
            )
        for name in (self.camera_name, *self.cameras):
            if not re.fullmatch(r"[a-z][a-z0-9_]{0,15}", name):
                raise ValueError(f"a camera's name must be up to 16 of a-z, 0-9 and _, a letter first, got {name!r}.")
        if len(self.cameras) > CAMERAS_MAX:
            raise ValueError(f"a robot has up to {1 + CAMERAS_MAX} cameras, got {1 + len(self.cameras)}.")
        for name, camera in self.cameras.items():
            if camera.latency_s != self.camera.latency_s:
                raise ValueError(
                    f"camera {name!r} has latency_s {camera.latency_s:g}, {self.camera_name!r} "
                    f"{self.camera.latency_s:g}; the cameras of a robot have the same."
                )

    @property
    def all_cameras(self) -> dict[str, CameraConfig]:
        """Every camera by name, the first one first."""
        return {self.camera_name: self.camera, **self.cameras}

    def with_cameras_of(self, other: "RobotConfig") -> "RobotConfig":
        """This robot with the cameras of another one.

        Args:
            other: Whose cameras it gets.
        """
        return dataclasses.replace(self, camera=other.camera, camera_name=other.camera_name, cameras=other.cameras)

    @cached_property
    def clock(self) -> Clock:
        """Its rates, and the step that it is simulated and recorded with."""
        return make_clock(self.control_hz, self.camera_hz)

    @property
    def reverses(self) -> bool:
        """True if it can drive backwards."""
        return self.v_min_mps < 0


def load_robot(path: str | Path, *, cameras_of: RobotConfig | None = None) -> RobotConfig:
    """Read a `robot.toml`.

    Args:
        path: The file.
        cameras_of: Whose cameras a robot has whose file names none; the default one if this is None.

    Raises:
        ConfigError: If the file is missing, is not TOML, or holds an unknown or wrong value; it names the file.
    """
    # Numba takes a second to load, which those who import a robot's class need not wait for.
    from readygo.common.camera.lens import make_lens

    try:
        mapping = read_toml(path)
    except (OSError, ValueError) as error:
        raise ConfigError(f"Robot file {path} cannot be read: {cause(error)}.") from error
    try:
        robot = section_from_mapping(RobotConfig, with_first_camera(mapping))
        if cameras_of is not None and not {"camera", "cameras"} & set(mapping):
            robot = robot.with_cameras_of(cameras_of)
        for camera in robot.all_cameras.values():
            make_lens(camera)
    except ConfigError as error:
        raise ConfigError(f"Robot file {path}: {error}") from error
    return robot


def with_first_camera(robot: Mapping[str, Any], where: str = "") -> Mapping[str, Any]:
    """Keys of a robot of which no camera is called the first: that is the one that [cameras.NAME] names first.

    Args:
        robot: The keys.
        where: Path of the robot's section, such as "robot.", for errors.

    Raises:
        ConfigError: If the first camera is no table, or has an unknown key or a wrong value.
    """
    cameras = robot.get("cameras")
    if not isinstance(cameras, Mapping) or not cameras or "camera" in robot:
        return robot
    (name, camera), *further = cameras.items()
    # Errors name the camera as the file does.
    section_from_mapping(CameraConfig, camera, where=f"{where}cameras.{name}.")
    return {**robot, "camera": camera, "camera_name": name, "cameras": dict(further)}
