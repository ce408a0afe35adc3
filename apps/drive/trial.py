"""One trial: the loop between robot and pilot, and its measurements."""

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from readygo.apps.drive.messages import VelocityMessage
from readygo.apps.drive.people import PeopleFinder
from readygo.apps.drive.pilot import Pilot, TrialEnding
from readygo.apps.drive.robot import Robot
from readygo.common.errors import BusError

PATIENCE_S = 10.0
"""Time within which the robot must send all required messages [s]."""
SAY_EVERY_S = 2.0
OUTCOMES = {
    "success": TrialEnding.GOAL,
    "timeout": TrialEnding.LATE,
    "static_collision": TrialEnding.STATIC_COLLISION,
    "human_collision": TrialEnding.HUMAN_COLLISION,
}
"""Endings by outcome, as a user reports them on a topic or in labels.toml."""
Say = Callable[[str], None]


@dataclass
class Measures:
    """Measurements of a trial's loop."""

    latencies_ms: list[float] = field(default_factory=list)
    """Times from the arrival of an image until its command was sent [ms]."""
    thinking_ms: list[float] = field(default_factory=list)
    """Part of these times for rectification and inference [ms]."""
    frame_ages_s: list[float] = field(default_factory=list)
    """Ages of images on arrival [s]."""
    sent: int = 0
    """Number of commands that were sent."""
    duration_s: float = 0.0
    """Duration of the drive [s]."""

    def summary(self) -> dict[str, float]:
        """Rates [Hz], latencies [ms] and the age of images on arrival [s] as plain values; empty without a drive."""
        if not self.latencies_ms or self.duration_s <= 0:
            return {}
        return {
            "inference_hz": round(len(self.latencies_ms) / self.duration_s, 2),
            "inference_hz_possible": round(1e3 / float(np.mean(self.thinking_ms)), 1),
            "command_hz": round(self.sent / self.duration_s, 2),
            "latency_median_ms": round(float(np.median(self.latencies_ms)), 2),
            "latency_p99_ms": round(float(np.percentile(self.latencies_ms, 99)), 2),
            "latency_max_ms": round(max(self.latencies_ms), 2),
            "frame_age_median_s": round(float(np.median(self.frame_ages_s)), 3),
        }


def run_trial(
    robot: Robot,
    pilot: Pilot,
    *,
    rate_hz: float,
    say: Say,
    people: PeopleFinder | None = None,
    measures: Measures | None = None,
) -> Measures:
    """Drive until the trial ends, then stop the robot, also after an error.

    Each decision of the policy is sent immediately, and the current command at least `rate_hz` times a second.

    Args:
        robot: Robot to drive.
        pilot: Pilot that drives.
        rate_hz: Lowest rate of commands [Hz].
        say: Called with a line of text when the robot waits, and when it drives again.
        people: Perceives people and free distances in the same images; they are published after the command is sent.
        measures: Measurements to continue and return, which are there after an error as well; new ones by default.

    Raises:
        BusError: If the robot does not send the required messages.
    """
    measures, period_s = Measures() if measures is None else measures, 1.0 / rate_hz
    began_s = next_s = told_s = time.monotonic()
    told: str | None = None
    try:
        while pilot.ending is None:
            _step(robot, pilot, measures, next_s, people)
            now_s = time.monotonic()
            if now_s >= next_s:
                next_s = max(next_s + period_s, now_s)
            if pilot.waiting_for != told or now_s - told_s > SAY_EVERY_S:
                told, told_s = pilot.waiting_for, now_s
                say(pilot.words)
            if pilot.started_ns is None and now_s - began_s > PATIENCE_S:
                raise BusError(_not_there(robot, pilot))
    except KeyboardInterrupt:
        pilot.end(TrialEnding.STOPPED)
    except BaseException as error:
        pilot.end(TrialEnding.FAILED, str(error))
        raise
    finally:
        robot.send(VelocityMessage())
        if pilot.started_ns is not None:
            measures.duration_s = (time.monotonic_ns() - pilot.started_ns) / 1e9
    return measures


def _step(robot: Robot, pilot: Pilot, measures: Measures, until_s: float, people: PeopleFinder | None = None) -> None:
    """Wait for an image or until a time, then send a command, and publish what is seen in the image."""
    newest = robot.next_picture(until_s)
    begin_ns = time.monotonic_ns()
    for odometry, arrived_ns in robot.odometry():
        pilot.hear(odometry, arrived_ns)
        if people is not None:
            people.hear(odometry, arrived_ns)
    seen = pilot.seen
    for name, picture, arrived_ns in robot.beside():
        pilot.look(picture, arrived_ns, name)
    if newest is not None:
        pilot.look(*newest)
    saw = pilot.seen > seen
    if saw:
        measures.thinking_ms.append((time.monotonic_ns() - begin_ns) / 1e6)
        measures.frame_ages_s.append(pilot.frame_age_s)
    if robot.broken:
        pilot.end(TrialEnding.BROKEN_MESSAGE, f"the robot sends what cannot be used: {robot.broken}")
    if robot.outcome in OUTCOMES:
        pilot.end(OUTCOMES[robot.outcome])
    robot.send(pilot.command(time.monotonic_ns()))
    if pilot.started_ns is not None:
        measures.sent += 1
        if saw:
            measures.latencies_ms.append((time.monotonic_ns() - pilot.seen_arrived_ns) / 1e6)
    if people is not None and newest is not None and (found := people.look(*newest)) is not None:
        robot.tell(*found)


def _not_there(robot: Robot, pilot: Pilot) -> str:
    why = robot.absent()
    return f"The robot cannot be driven: {pilot.waiting_for} after {PATIENCE_S:g} s{f'; {why}' if why else ''}."


def trial_end(pilot: Pilot, measures: Measures) -> dict[str, Any]:
    """The end of a trial as plain values, for its log."""
    ending = pilot.ending or TrialEnding.FAILED
    return {
        "ending": ending.name.lower(),
        "reason": pilot.reason,
        "duration_s": round(measures.duration_s, 3),
        "driven_m": round(pilot.driven_m, 3),
        "straight_m": round(pilot.straight_m, 3),
        "goal_distance_m": round(pilot.goal_distance_m, 3) if pilot.goal else None,
        "speed_at_end_mps": round(pilot.moving_mps, 3),
        "measures": measures.summary(),
    }
