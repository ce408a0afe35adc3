"""The episodes that training learns from and those that it holds out."""

from collections.abc import Iterable
from typing import Any

from readygo.common.dataset import Dataset
from readygo.common.errors import ConfigError, DatasetError
from readygo.common.images.names import GOAL_IMAGE, RGB
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import command_grid
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.episodes import TrainingEpisode, read_episodes, robot_of_source
from readygo.services.trainer.frames import FrameCache
from readygo.services.trainer.looked import LookCache
from readygo.services.trainer.pooling import pooling_of
from readygo.services.trainer.reservoir import Reservoir
from readygo.services.trainer.samples import TrainingSamples, WindowTiming, episode_table, held_out_names, join_tables

HELD_OUT_SHARE = 0.2
"""Share of the memory for episodes and for decoded frames that held-out episodes get."""


class EpisodePart:
    """Episodes to train on, or to hold out."""

    def __init__(self, robot: RobotConfig, config: TrainConfig, share: float) -> None:
        """Without episodes so far.

        Args:
            robot: Whose cameras took the images.
            config: How much memory there is, and which steps belong together.
            share: The part's share of the memory.
        """
        self.reservoir = Reservoir(int(share * config.memory_mb * 1e6), config.seed)
        looks = config.network.encoder == "perception"
        limit_bytes = int(share * config.cache_mb * 1e6)
        frames = FrameCache(
            self.reservoir,
            robot,
            pooling=pooling_of(robot.camera, config.network.pooled_height_px),
            limit_bytes=0 if looks else limit_bytes,
            images=config.network.images,
        )
        self.frames = LookCache(frames, limit_bytes=limit_bytes) if looks else frames
        """The images as training takes them."""
        self._robot, self._timing = robot, timing_of(robot, config)
        self._tables: dict[str, TrainingSamples] = {}
        self._joined: tuple[int, TrainingSamples] | None = None

    @property
    def table(self) -> TrainingSamples:
        """The numbers of the episodes that there are now.

        Raises:
            DatasetError: If there are none.
        """
        episodes = self.reservoir.episodes
        if self._joined is None or self._joined[0] != self.reservoir.version:
            known = self._tables
            self._tables = {
                name: known[name] if name in known else episode_table(episode, self._robot, self._timing)
                for name, episode in episodes.items()
            }
            self._joined = self.reservoir.version, join_tables(list(self._tables.values()))
        return self._joined[1]


def timing_of(robot: RobotConfig, config: TrainConfig) -> WindowTiming:
    """Which steps belong together.

    Raises:
        ConfigError: If the robot's camera takes no images that are as far apart as the frames shall be.
    """
    clock = robot.clock
    try:
        spacing_steps = clock.spacing_steps(config.sampling.frame_spacing_s)
    except ValueError as error:
        raise ConfigError(f"The robot's camera takes {robot.camera_hz} images a second: {error}") from error
    return WindowTiming(
        clock=clock,
        command_count=len(command_grid(robot)),
        spacing_steps=spacing_steps,
        frame_count=config.network.frame_count,
        latency_steps=clock.steps(robot.camera.latency_s),
        ahead_steps=clock.steps(config.sampling.ahead_s),
        to_image=config.network.encoder == "perception",
    )


def build_parts(source: Dataset, validation: Dataset | None, config: TrainConfig) -> tuple[EpisodePart, EpisodePart]:
    """What is trained on and what is held out: episodes of `validation`, or else some of `source`.

    Raises:
        DatasetError: If there are too few episodes, or the robots of the sources differ.
    """
    robot = robot_of_source(source)
    wanted: dict[str, Any] = {"with_humans": config.sampling.humans_weight > 0, "outputs": outputs_of(config)}
    if validation is not None and robot_of_source(validation) != robot:
        raise DatasetError("Training and validation data were recorded with different robots; use one robot.toml.")
    training, held_out = EpisodePart(robot, config, 1 - HELD_OUT_SHARE), EpisodePart(robot, config, HELD_OUT_SHARE)
    if validation is not None:
        if not source.episodes or not validation.episodes:
            raise DatasetError("Training and validation data need at least one episode each.")
        _fill(training, read_episodes(source, **wanted))
        _fill(held_out, read_episodes(validation, **wanted))
        return training, held_out
    names = held_out_names([entry.sha256 for entry in source.episodes], config.validation_fraction)
    for episode in read_episodes(source, **wanted):
        (held_out if episode.name in names else training).reservoir.add(episode)
    return training, held_out


def outputs_of(config: TrainConfig) -> tuple[str, ...]:
    """The images besides rgb that are learned from."""
    goal = () if config.network.goal == "point" else (GOAL_IMAGE,)
    return (*(name for name in config.network.images if name != RGB), *goal)


def _fill(part: EpisodePart, episodes: Iterable[TrainingEpisode]) -> None:
    for episode in episodes:
        part.reservoir.add(episode)
