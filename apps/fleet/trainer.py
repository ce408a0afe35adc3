"""A trainer beside a fleet: reads committed episodes, and offers policies to the fleet."""

import threading
from collections.abc import Iterator
from functools import partial
from pathlib import Path
from typing import Any

from readygo.apps.fleet.access import SPEC_TIMEOUT_S
from readygo.common.bus import Bus
from readygo.common.bus.identity import TRAINER
from readygo.common.dataset import committed_episodes
from readygo.common.errors import RunError
from readygo.common.messages import CommittedEpisode, EpisodeKey, RunSpec, RunSpecRequest, topics
from readygo.common.messages.live import LiveLoss
from readygo.runs.origin import note_origin, origin_of_runs
from readygo.runs.training import torch_needed
from readygo.runs.world import World
from readygo.services.trainer import TrainConfig

OFFER_TIMEOUT_S = 10.0


def train_beside(
    buses: dict[str, Bus], config: TrainConfig, out: Path, *, data: tuple[Path, ...], stop: threading.Event
) -> dict[str, Any]:
    """Train on the episodes that fleets commit until `stop`; returns the content of `metrics.json`.

    Args:
        buses: The fleets by the names of their runs; all must have the same robot and sensor.
        config: Budget and settings.
        out: Folder of the policy.
        data: Data folders to catch up from, also while they are recorded: those of the runs, in the order of `buses`,
            and others after them.
        stop: Ends training.

    Raises:
        RunError: If the fleets have different robots, or do not record images of goals that are to be learned from.
        PolicyError: If torch is not installed, `out` belongs to another run, or the loss is not finite.
    """
    with torch_needed():
        from readygo.services.trainer import LiveTrainer, training_threads
    specs = [bus.request(topics.SPEC, RunSpecRequest(), timeout_s=SPEC_TIMEOUT_S) for bus in buses.values()]
    robot, sensor = _camera(specs)
    _check_goals(specs, config)
    reader = Reader({folder: run for run, folder in zip([*buses, *map(str, data[len(buses) :])], data, strict=False)})

    def offer(request: Any) -> Any:
        replies = [bus.request(topics.OFFER, request, timeout_s=OFFER_TIMEOUT_S) for bus in buses.values()]
        return replies[0]

    def show(loss: LiveLoss) -> None:
        for bus in buses.values():
            bus.tell(topics.LOSS, lambda: loss)

    with training_threads(config):
        trainer = LiveTrainer(robot, sensor, config, out, offer=offer, catch_up=reader.new_episodes, show=show)
        for run, bus in buses.items():
            bus.subscribe(topics.COMMITTED, partial(trainer.hear, run))
            bus.announce(TRAINER, TRAINER)
        metrics = trainer.train(stop)
    if metrics:
        note_origin(out, origin_of_runs(specs))
    return metrics


class Reader:
    """Reads every durable episode of some folders once."""

    def __init__(self, runs: dict[Path, str]) -> None:
        """Begin with no episode read.

        Args:
            runs: Names of the runs by data folder.
        """
        self._runs = runs
        self._known: dict[Path, set[EpisodeKey]] = {folder: set() for folder in runs}

    def new_episodes(self) -> Iterator[tuple[str, CommittedEpisode]]:
        """Episodes that are new since the last call, with the names of their runs."""
        for folder, run in self._runs.items():
            known = self._known[folder]
            for episode in committed_episodes(folder, frozenset(known)):
                known.add(episode.header.episode)
                yield run, episode


def _check_goals(specs: list[RunSpec], config: TrainConfig) -> None:
    if config.network.goal != "point" and not all(World(spec).config.renderer.goal_image for spec in specs):
        raise RunError(
            f'The fleet records no images of goals, and goal "{config.network.goal}" learns from them: record with '
            "goal_image = true under [renderer] of --config."
        )


def _camera(specs: list[RunSpec]) -> tuple[Any, Any]:
    """Robot and sensor of the runs.

    Raises:
        RunError: If they differ.
    """
    configs = [World(spec).config for spec in specs]
    robot, sensor = configs[0].robot, configs[0].renderer.sensor
    if any((config.robot, config.renderer.sensor) != (robot, sensor) for config in configs):
        raise RunError("The fleets have different robots or sensors; train one policy for each.")
    return robot, sensor
