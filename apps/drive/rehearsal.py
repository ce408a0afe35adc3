"""A pilot in an episode, in simulated time: the loop of a trial without a network or a clock."""

import heapq
from functools import partial

import numpy as np
import numpy.typing as npt

from readygo.apps.drive.messages import Picture
from readygo.apps.drive.pilot import Pilot
from readygo.apps.drive.simulated import Look, Manners, odometry_of
from readygo.apps.drive.trial import PATIENCE_S
from readygo.common.episode import EpisodeSimulation
from readygo.common.messages import Outcome
from readygo.common.robot.kinematics import DT_S, STEP_NS

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
    on_their_way: list[tuple[int, int, Picture, Picture | None]] = []
    now_ns, newest_ns, step = _BEGIN_NS, 0, 0
    while simulation.outcome is None:
        pilot.hear(odometry_of(simulation, now_ns), now_ns)
        if manners.sends(step, rng):
            rgb, depth_m = look(simulation)
            picture = Picture(stamp_ns=now_ns, decode=partial(_bgr, rgb))
            depth = None if depth_m is None else Picture(stamp_ns=now_ns, decode=partial(_same, depth_m))
            newest_ns = max(now_ns + round(manners.late_s(rng) * 1e9), newest_ns)
            heapq.heappush(on_their_way, (newest_ns, step, picture, depth))
        end_ns = now_ns + STEP_NS
        while on_their_way and on_their_way[0][0] < end_ns:
            arrived_ns, _, picture, depth = heapq.heappop(on_their_way)
            if depth is not None:
                pilot.look_at_depth(depth, arrived_ns)
            pilot.look(picture, arrived_ns)
            pilot.command(arrived_ns)
        command = pilot.command(end_ns - 1)
        if pilot.started_ns is not None or step * DT_S > PATIENCE_S:
            # What comes within a step counts for all of it, as a decision does in an evaluation.
            simulation.advance(command.v_mps, command.w_radps)
        now_ns, step = end_ns, step + 1
    return simulation.outcome


def _same(depth_m: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    return depth_m


def _bgr(rgb: npt.NDArray[np.uint8]) -> npt.NDArray[np.uint8]:
    return np.ascontiguousarray(rgb[..., ::-1])
