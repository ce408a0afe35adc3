"""Episodes in lockstep: every step asks the driver once for all that run."""

from collections.abc import Callable, Iterator, Sequence

from readygo.common.episode.simulation import EpisodeSimulation
from readygo.common.messages import RobotTrajectory
from readygo.services.evaluator.drivers import Driver
from readygo.services.evaluator.episodes import MatchedEpisode

Simulate = Callable[[MatchedEpisode], EpisodeSimulation]


def roll_out(
    episodes: Sequence[MatchedEpisode], driver: Driver, simulate: Simulate, *, lockstep: int
) -> Iterator[tuple[int, RobotTrajectory]]:
    """Drive through all episodes, `lockstep` at a time; the next one starts as soon as one ends.

    Yields:
        Row in `episodes` and the robot's run, in the order in which episodes end.
    """
    waiting = iter(enumerate(episodes))
    running: list[tuple[int, EpisodeSimulation]] = []
    while True:
        while len(running) < lockstep and (following := next(waiting, None)) is not None:
            simulation = simulate(following[1])
            driver.start(simulation)
            running.append((following[0], simulation))
        if not running:
            return
        commands = driver.commands([simulation for _, simulation in running])
        ended = []
        for (row, simulation), (v_mps, w_radps) in zip(running, commands, strict=True):
            if simulation.advance(v_mps, w_radps) is not None:
                ended.append(row)
                driver.stop(simulation)
                yield row, simulation.trajectory()
        running = [item for item in running if item[0] not in ended]
