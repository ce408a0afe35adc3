"""A pilot in an episode, in simulated time: the loop of a trial without a network or a clock."""

import heapq
from functools import partial

import numpy as np

from readygo.apps.drive.messages import Picture
from readygo.apps.drive.pilot import Pilot
from readygo.apps.drive.simulated import Look, Manners, odometry_of, sent
from readygo.apps.drive.trial import PATIENCE_S
from readygo.common.episode import EpisodeSimulation
from readygo.common.messages import Outcome

_BEGIN_NS = 10**18
"""The robot's clock at the start [ns]."""


def rehearsed(
    pilot: Pilot, simulation: EpisodeSimulation, look: Look, manners: Manners, rng: np.random.Generator
) -> Outcome:
    """Drive through an episode.

    Args:
        pilot: Who drives.
        simulation: The episode at its start; it begins when the pilot can drive, at the latest after `PATIENCE_S`.
        look: What the robot sees.
        manners: How late and how unreliably its images come.
        rng: Of that.
    """
    on_their_way: list[tuple[int, int, str, Picture]] = []
    newest_ns: dict[str, int] = {}
    now_ns, taken, step = _BEGIN_NS, 0, 0
    clock, every = simulation.clock, manners.image_every(simulation.clock)
    while simulation.outcome is None:
        pilot.hear(odometry_of(simulation, now_ns), now_ns)
        late_s = manners.sent(pilot.images, rng) if step % every == 0 else {}
        images = look(simulation) if late_s else {}
        for name, late in late_s.items():
            newest_ns[name] = max(now_ns + round(late * 1e9), newest_ns.get(name, 0))
            picture = Picture(stamp_ns=now_ns, decode=partial(sent, images[name]))
            heapq.heappush(on_their_way, (newest_ns[name], taken, name, picture))
            taken += 1
        end_ns = _BEGIN_NS + clock.time_ns(step + 1)
        while on_their_way and on_their_way[0][0] < end_ns:
            arrived_ns, _, name, picture = heapq.heappop(on_their_way)
            seen = pilot.seen
            pilot.look(picture, arrived_ns, name)
            if pilot.seen > seen:
                pilot.command(arrived_ns)
        command = pilot.command(end_ns - 1)
        if pilot.started_ns is not None or step * clock.dt_s > PATIENCE_S:
            # What comes within a step counts for all of it, as a decision does in an evaluation.
            simulation.advance(command.v_mps, command.w_radps)
        now_ns, step = end_ns, step + 1
    return simulation.outcome
