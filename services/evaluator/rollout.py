"""Episodes in lockstep: every step asks the driver once for all that run."""

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

from readygo.common.episode.simulation import EpisodeSimulation
from readygo.services.evaluator.drivers import Driver, DriverFailure, State
from readygo.services.evaluator.episodes import MatchedEpisode

Simulate = Callable[[MatchedEpisode], EpisodeSimulation]


@dataclass(frozen=True, kw_only=True, eq=False)
class Run:
    """An episode that has ended."""

    row: int
    """Which of the episodes."""
    simulation: EpisodeSimulation
    failure: str = ""
    """Why its driver gave no command; empty if it always did."""


def roll_out(
    episodes: Sequence[MatchedEpisode], driver: Driver[State], simulate: Simulate, *, lockstep: int
) -> Iterator[Run]:
    """Drive through all episodes, `lockstep` at a time; the next one starts as soon as one ends.

    A robot whose driver fails stands from then on, until its episode is over; the others go on.

    Yields:
        Runs in the order in which they end.
    """
    waiting = iter(enumerate(episodes))
    running: dict[int, tuple[EpisodeSimulation, State]] = {}
    while True:
        while len(running) < lockstep and (following := next(waiting, None)) is not None:
            row, episode = following
            simulation = simulate(episode)
            running[row] = simulation, driver.start(simulation)
        if not running:
            return
        commands = driver.commands(list(running.values()))
        for row, command in zip(list(running), commands, strict=True):
            simulation, _ = running[row]
            failure = _failure(command)
            if isinstance(command, DriverFailure) or failure:
                _stand(simulation)
            elif simulation.advance(*command) is None:
                continue
            del running[row]
            yield Run(row=row, simulation=simulation, failure=failure)


def _failure(command: tuple[float, float] | DriverFailure) -> str:
    if isinstance(command, DriverFailure):
        return command.reason
    return "" if all(map(math.isfinite, command)) else f"it commanded ({command[0]:g}, {command[1]:g})"


def _stand(simulation: EpisodeSimulation) -> None:
    while simulation.outcome is None:
        simulation.advance(0.0, 0.0)
