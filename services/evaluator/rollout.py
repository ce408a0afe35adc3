"""Episodes in lockstep: every step asks the driver once for all that run."""

from collections.abc import Callable, Iterator, Sequence

from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.messages import RobotTrajectory
from readygo.services.evaluator.drivers import Driver, State
from readygo.services.evaluator.episodes import MatchedEpisode

Simulate = Callable[[MatchedEpisode], EpisodeSimulation]


def roll_out(
    episodes: Sequence[MatchedEpisode], driver: Driver[State], simulate: Simulate, *, lockstep: int
) -> Iterator[tuple[int, RobotTrajectory]]:
    """Drive through all episodes, `lockstep` at a time; the next one starts as soon as one ends.

    Yields:
        Row in `episodes` and the robot's run, in the order in which episodes end.
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
        for row, (v_mps, w_radps) in zip(list(running), commands, strict=True):
            simulation, _ = running[row]
            if simulation.advance(v_mps, w_radps) is not None:
                del running[row]
                yield row, simulation.trajectory()
