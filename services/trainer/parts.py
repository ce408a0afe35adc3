"""The episodes that training learns from and those that it holds out."""

from dataclasses import dataclass

from readygo.common.errors import DatasetError
from readygo.common.robot import RobotConfig
from readygo.services.trainer.config import TrainConfig
from readygo.services.trainer.frames import FrameCache
from readygo.services.trainer.samples import EpisodeRange, SampleSource, SampleTable, build_table, split_episodes


@dataclass(frozen=True, kw_only=True, eq=False)
class Part:
    """Episodes of one source, to train on or to hold out."""

    source: SampleSource
    episodes: list[EpisodeRange]
    table: SampleTable
    frames: FrameCache


def robot_of_source(source: SampleSource) -> RobotConfig:
    """The robot that the samples were recorded with.

    Raises:
        DatasetError: If the data do not tell.
    """
    if source.robot is None:
        raise DatasetError("The data do not tell which robot recorded them; record them anew.")
    return source.robot


def build_parts(source: SampleSource, validation: SampleSource | None, config: TrainConfig) -> tuple[Part, Part]:
    """What is trained on and what is held out: episodes of `validation`, or else some of `source`.

    Raises:
        DatasetError: If there are too few episodes, or the robots of the sources differ.
    """
    robot = robot_of_source(source)
    camera, limit_bytes = robot.camera, config.cache_mb * 1_000_000
    if validation is not None and robot_of_source(validation) != robot:
        raise DatasetError("Training and validation data were recorded with different robots; use one robot.toml.")

    def cache(of: SampleSource, share: float) -> FrameCache:
        limit = int(limit_bytes * share)
        return FrameCache(of, height_px=camera.height_px, width_px=camera.width_px, limit_bytes=limit)

    if validation is None:
        training, held_out = split_episodes(source.episodes, config.validation_fraction)
        table, frames = build_table(source), cache(source, 1.0)
        shared = {"source": source, "table": table, "frames": frames}
        return Part(episodes=training, **shared), Part(episodes=held_out, **shared)  # type: ignore[arg-type]
    if not source.episodes or not validation.episodes:
        raise DatasetError("Training and validation data need at least one episode each.")
    return (
        Part(source=source, episodes=list(source.episodes), table=build_table(source), frames=cache(source, 0.8)),
        Part(
            source=validation,
            episodes=list(validation.episodes),
            table=build_table(validation),
            frames=cache(validation, 0.2),
        ),
    )
