"""Every setting of a run, by section."""

import dataclasses
import tomllib
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Literal

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.episode import EpisodeConfig
from readygo.common.errors import ConfigError
from readygo.common.robot import RobotConfig
from readygo.services.animator.config import AnimatorConfig
from readygo.services.coordinator.config import CoordinatorConfig
from readygo.services.planner.config import HumanPlannerConfig
from readygo.services.planner.expert.config import ExpertConfig
from readygo.services.planner.humans.recipes import PEOPLE_RECIPES, PeopleName
from readygo.services.recorder.config import RecorderConfig
from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.sensor.config import SENSOR_RECIPES, SensorName


@dataclass(frozen=True, kw_only=True)
class RunConfig:
    """Every setting of a run, by section; recorded with its data."""

    robot: RobotConfig = field(default_factory=RobotConfig)
    episode: EpisodeConfig = field(default_factory=EpisodeConfig)
    human_planner: HumanPlannerConfig = field(default_factory=HumanPlannerConfig)
    expert: ExpertConfig = field(default_factory=ExpertConfig)
    animator: AnimatorConfig = field(default_factory=AnimatorConfig)
    renderer: RendererConfig = field(default_factory=RendererConfig)
    recorder: RecorderConfig = field(default_factory=RecorderConfig)
    coordinator: CoordinatorConfig = field(default_factory=CoordinatorConfig)


def load_run_config(
    path: Path | None,
    robot: RobotConfig | None = None,
    sensor: SensorName | None = None,
    people: PeopleName | None = None,
) -> RunConfig:
    """The defaults, changed by the sections of a TOML file, by another robot and by recipes of a sensor and of people.

    Raises:
        ConfigError: If the file cannot be read or holds an unknown key or a wrong value.
    """
    if path is None:
        config = RunConfig()
    else:
        try:
            config = section_from_mapping(RunConfig, tomllib.loads(path.read_text()))
        except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
            raise ConfigError(f"Configuration {path} cannot be read: {error}.") from error
    if sensor is not None:
        renderer = dataclasses.replace(config.renderer, sensor=SENSOR_RECIPES[sensor]())
        config = dataclasses.replace(config, renderer=renderer)
    if people is not None:
        episode, planner = PEOPLE_RECIPES[people](config.episode, config.human_planner)
        config = dataclasses.replace(config, episode=episode, human_planner=planner)
    return config if robot is None else dataclasses.replace(config, robot=robot)


def with_outputs(config: RunConfig, names: str) -> RunConfig:
    """The configuration with other recorded images.

    Args:
        config: A configuration.
        names: Names of the images, separated by commas.

    Raises:
        ConfigError: If a name is unknown, or rgb is missing.
    """
    try:
        renderer = dataclasses.replace(config.renderer, outputs=tuple(name.strip() for name in names.split(",")))
    except ValueError as error:
        raise ConfigError(f"--{error}") from error
    return dataclasses.replace(config, renderer=renderer)


def with_detail(config: RunConfig, detail: Literal["exact", "lod"]) -> RunConfig:
    """The configuration with another level of detail.

    Raises:
        ConfigError: If the configuration's backend has none.
    """
    try:
        renderer = dataclasses.replace(config.renderer, detail=detail)
    except ValueError as error:
        raise ConfigError(f"--detail: {error}") from error
    return dataclasses.replace(config, renderer=renderer)


def resolved_sections(config: RunConfig) -> dict[str, Any]:
    """The configuration as plain mappings, as it travels in the run's spec."""
    return section_to_mapping(config)
