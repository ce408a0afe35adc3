"""Every setting of a run, by section."""

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any

from tyro.conf import Fixed

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import ConfigError
from readygo.common.messages import RunSpec
from readygo.common.robot import RobotConfig
from readygo.common.robot.config import with_first_camera
from readygo.runs.sections import NO_KEYS, Keys, Sections, merge_tables, read_sections, with_keys
from readygo.services.animator import AnimatorConfig
from readygo.services.coordinator import CoordinatorConfig
from readygo.services.driver import DriverConfig
from readygo.services.planner import MIXES, ExpertConfig, HumanPlannerConfig, MixName
from readygo.services.recorder import RecorderConfig
from readygo.services.renderer import SENSOR_RECIPES, RendererConfig, SensorName

_NOT_OF_RUNS = ("learn",)
"""Sections of a configuration file that runs ignore: `readygo learn` reads them."""
_WITH_WHOLE_TABLES = ("robot", "human_planner")
"""Sections whose tables are given whole: keys that such a table lacks have their defaults."""


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Every setting of a run, by section; recorded with its data."""

    robot: RobotConfig = field(default_factory=RobotConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    human_planner: HumanPlannerConfig = field(default_factory=HumanPlannerConfig)
    expert: ExpertConfig = field(default_factory=ExpertConfig)
    driver: DriverConfig = field(default_factory=DriverConfig)
    animator: AnimatorConfig = field(default_factory=AnimatorConfig)
    renderer: RendererConfig = field(default_factory=RendererConfig)
    recorder: RecorderConfig = field(default_factory=RecorderConfig)
    coordinator: CoordinatorConfig = field(default_factory=CoordinatorConfig)

    def __post_init__(self) -> None:
        clock = self.robot.clock
        every = self.driver.image_every(clock)
        if every > clock.image_every and clock.steps(self.robot.camera.latency_s) % every:
            raise ConfigError(
                f"[driver] camera_hz {self.driver.camera_hz:g}: the camera's latency of "
                f"{self.robot.camera.latency_s:g} s must be a multiple of the time between pictures."
            )


RunKeys = Annotated[Keys, Sections(RunConfig), Fixed]
"""Keys of a run's settings as the command line gives them: the type of a field of a command's options."""
EvaluationKeys = Annotated[Keys, Sections(RunConfig, without=("recorder",)), Fixed]
"""Keys for a command that records no data."""
SimulationKeys = Annotated[Keys, Sections(RunConfig, without=("recorder", "coordinator")), Fixed]
"""Keys for a command that simulates in its own process and records no data."""


def load_run_config(
    path: Path | None,
    robot: RobotConfig | None = None,
    sensor: SensorName | None = None,
    people: MixName | None = None,
    *,
    base: RunConfig | None = None,
    keys: Keys = NO_KEYS,
) -> RunConfig:
    """The base settings, changed by the sections of a TOML file, by a robot, a sensor recipe, a scenario mix and keys.

    Args:
        path: TOML file with sections of settings.
        robot: Robot to use instead of the file's.
        sensor: Recipe for the optics of the robot's camera and their variation.
        people: Scenario mix: how many humans there are and how they meet the robot.
        base: Settings that file and arguments do not change; the defaults if None.
        keys: Keys of the command line, by section.

    Raises:
        ConfigError: If the file cannot be read or holds an unknown key or a wrong value.
    """
    config = base or RunConfig()
    if path is not None:
        config = _read_config(path, config)
    if robot is not None:
        config = dataclasses.replace(config, robot=robot)
    if sensor is not None:
        config = _with_sensor(config, sensor)
    if people is not None:
        config = with_mix(config, people)
    return with_keys(config, keys)


def with_mix(config: RunConfig, people: MixName) -> RunConfig:
    """The configuration with a scenario mix: how many humans there are and how they meet the robot."""
    episode, planner = MIXES[people](config.episode, config.human_planner)
    return dataclasses.replace(config, episode=episode, human_planner=planner)


def _with_sensor(config: RunConfig, name: SensorName) -> RunConfig:
    """The configuration with the optics of a recipe and their variation in all cameras."""
    recipe, robot = SENSOR_RECIPES[name], config.robot
    camera, renderer = recipe(robot.camera, config.renderer)
    cameras = {each: recipe(further, config.renderer)[0] for each, further in robot.cameras.items()}
    return dataclasses.replace(
        config, robot=dataclasses.replace(robot, camera=camera, cameras=cameras), renderer=renderer
    )


def _read_config(path: Path, base: RunConfig) -> RunConfig:
    """The sections of a TOML file over those of `base`; a robot in the file inherits only the cameras of `base`."""
    sections = {name: keys for name, keys in read_sections(path).items() if name not in _NOT_OF_RUNS}
    try:
        if isinstance(sections.get("robot"), Mapping):
            sections["robot"] = with_first_camera(sections["robot"], "robot.")
            own = {"camera", "cameras"} & set(sections["robot"])
            robot = RobotConfig(camera=base.robot.camera) if own else RobotConfig().with_cameras_of(base.robot)
            base = dataclasses.replace(base, robot=robot)
        return merge_sections(base, sections)
    except ConfigError as error:
        raise ConfigError(f"Configuration {path}: {error}") from error


def merge_sections(base: RunConfig, sections: Mapping[str, Any]) -> RunConfig:
    """The configuration with the keys of some sections, given as plain values.

    Cameras, ranges of the robot and the mix of pedestrians are given whole.

    Raises:
        ConfigError: If a key is unknown or a value wrong.
    """
    whole = section_to_mapping(base)
    merged = merge_tables(whole, sections)
    for name in _WITH_WHOLE_TABLES:
        if isinstance(section := sections.get(name), Mapping):
            merged[name] = {**whole[name], **section}
    return section_from_mapping(RunConfig, merged)


def check_cameras(config: RunConfig) -> None:
    """Raise ConfigError if the ranges of sensor and robot exceed what a camera can have, or the backend can draw."""
    # Imported here: Numba takes a second to load, which reading settings does not need.
    from readygo.common.camera.lens import check_sensor

    config.renderer.check_robot(config.robot)
    for camera in config.robot.all_cameras.values():
        check_sensor(config.renderer.sensor, camera)


def with_run_keys(spec: RunSpec, keys: Keys) -> RunSpec:
    """The run with keys of the command line; the run's name stays.

    Raises:
        ConfigError: If a value is out of range.
    """
    changed = section_to_mapping(with_keys(config_of(spec), keys))
    return dataclasses.replace(spec, config={**spec.config, **{name: changed[name] for name in keys}})


def config_of(spec: RunSpec) -> RunConfig:
    """The settings of a run.

    Raises:
        ConfigError: If they are those of another version of readygo.
    """
    try:
        return section_from_mapping(RunConfig, spec.config)
    except ConfigError as error:
        recorded = spec.metadata.get("readygo_version", "(unknown)")
        raise ConfigError(
            f"The run's settings, by readygo {recorded}, are none of this version: {error} Begin a new run, or use "
            "that version."
        ) from error


def resolved_sections(config: RunConfig) -> dict[str, Any]:
    """The configuration as plain mappings, for the run's spec."""
    return section_to_mapping(config)
