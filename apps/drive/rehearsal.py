"""Offline simulation of a trial: a pilot in an episode, in simulated time, without a network or a clock."""

import heapq
from collections.abc import Sequence
from functools import partial

import numpy as np

from readygo.apps.drive.messages import ImageMessage
from readygo.apps.drive.messages import VelocityMessage as RobotCommand
from readygo.apps.drive.pilot import Pilot
from readygo.apps.drive.simulated import Look, Manners, odometry_of, to_message_order
from readygo.apps.drive.trial import PATIENCE_S
from readygo.common.episode import EpisodeSimulation
from readygo.common.episode.loop import Command, DriverFailure, run_episode
from readygo.common.messages import Outcome

_BEGIN_NS = 10**18
"""The robot's clock at the start [ns]."""


def simulate_drive(
    pilot: Pilot, simulation: EpisodeSimulation, look: Look, manners: Manners, rng: np.random.Generator
) -> Outcome:
    """Drive through an episode.

    Args:
        pilot: Pilot that drives.
        simulation: The episode at its start; it begins when the pilot can drive, at the latest after `PATIENCE_S`.
        look: Returns the robot's camera images.
        manners: Latency and losses of the images.
        rng: Random generator of latency and losses.
    """
    run_episode(simulation, PilotDriver(pilot, look, manners, rng))
    assert simulation.outcome is not None
    return simulation.outcome


class PilotDriver:
    """A pilot behind a simulated network that delays and loses images; drives one episode."""

    looks = True

    def __init__(self, pilot: Pilot, look: Look, manners: Manners, rng: np.random.Generator) -> None:
        """Prepare an episode; arguments as in `simulate_drive`."""
        self._pilot, self._look, self._manners, self._rng = pilot, look, manners, rng
        self._on_their_way: list[tuple[int, int, str, ImageMessage]] = []
        self._newest_ns: dict[str, int] = {}
        self._now_ns, self._taken, self._step = _BEGIN_NS, 0, 0
        self._ready: RobotCommand | None = None

    def start(self, simulation: EpisodeSimulation) -> None:
        """Let the robot stand until the pilot can drive, at the latest after `PATIENCE_S`."""
        while self._ready is None:
            waited_s = self._step * simulation.clock.dt_s
            command = self._live(simulation)
            if self._pilot.started_ns is not None or waited_s > PATIENCE_S:
                self._ready = command

    def act(self, running: Sequence[tuple[EpisodeSimulation, None]]) -> list[Command | DriverFailure]:
        """The command of the one episode, after one step of simulated time."""
        ((simulation, _),) = running
        command, self._ready = self._ready or self._live(simulation), None
        return [(command.v_mps, command.w_radps)]

    def _live(self, simulation: EpisodeSimulation) -> RobotCommand:
        """Simulate one step: the robot sends, messages arrive at the pilot; returns the command at the step's end.

        A command within a step holds for the whole step, as a decision does in an evaluation.
        """
        pilot, clock = self._pilot, simulation.clock
        pilot.hear(odometry_of(simulation, self._now_ns), self._now_ns)
        self._send(simulation)
        end_ns = _BEGIN_NS + clock.time_ns(self._step + 1)
        while self._on_their_way and self._on_their_way[0][0] < end_ns:
            arrived_ns, _, name, picture = heapq.heappop(self._on_their_way)
            seen = pilot.seen
            pilot.look(picture, arrived_ns, name)
            if pilot.seen > seen:
                pilot.command(arrived_ns)
        command = pilot.command(end_ns - 1)
        self._now_ns, self._step = end_ns, self._step + 1
        return command

    def _send(self, simulation: EpisodeSimulation) -> None:
        """Take an image if one is due, and send those that are not lost."""
        due = self._step % self._manners.image_every(simulation.clock) == 0
        late_s = self._manners.draw_latencies(self._pilot.images, self._rng) if due else {}
        images = self._look(simulation) if late_s else {}
        for name, late in late_s.items():
            self._newest_ns[name] = max(self._now_ns + round(late * 1e9), self._newest_ns.get(name, 0))
            picture = ImageMessage(stamp_ns=self._now_ns, decode=partial(to_message_order, images[name]))
            heapq.heappush(self._on_their_way, (self._newest_ns[name], self._taken, name, picture))
            self._taken += 1
