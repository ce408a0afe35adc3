"""The few moments that explain an episode: what was seen, when the way changed, how close it came."""

from dataclasses import dataclass

import numpy as np

from readygo.common.messages import Outcome
from readygo.services.planner.explain.journal import DrivenRun

MOMENTS_MAX = 3
APART_S = 0.5
"""Moments nearer to each other show the same [s]."""
CLOSE_M = 3.0
"""A human that stays farther away needs no separate moment [m]."""


@dataclass(frozen=True, kw_only=True)
class RunMoment:
    """One step of a run, and why it is shown."""

    step: int
    why: str


def pick_moments(run: DrivenRun) -> tuple[RunMoment, ...]:
    """At most three moments, in order of time; the more telling one wins where two are close."""
    picked: list[RunMoment] = []
    for moment in _candidates(run):
        near = any(abs(moment.step - other.step) < APART_S * run.trajectory.rate_hz for other in picked)
        if not near and len(picked) < MOMENTS_MAX:
            picked.append(moment)
    return tuple(sorted(picked, key=lambda moment: moment.step))


def _candidates(run: DrivenRun) -> list[RunMoment]:
    """Most telling first: the end of a failure, the closest approach, the change of plan before it, first sights."""
    last, humans = len(run.trajectory.xyyaw) - 1, range(len(run.scenario.humans))
    moments = []
    if run.trajectory.outcome is not Outcome.SUCCESS:
        moments.append(RunMoment(step=last, why=run.trajectory.outcome.value.replace("_", " ")))
    closest = sorted((float(run.gap_m(k).min()), k) for k in humans)
    if closest and closest[0][0] < CLOSE_M:
        step = int(np.argmin(run.gap_m(closest[0][1])))
        moments.append(RunMoment(step=step, why=f"closest to pedestrian {closest[0][1] + 1}"))
        given_up = run.journal.given_up if run.explained else ()
        changed = [k for k in given_up if k < step - APART_S * run.trajectory.rate_hz and run.journal.perceived[k]]
        moments += [RunMoment(step=k, why="takes another path") for k in changed[-1:]]
    for _, k in closest:
        seen = np.flatnonzero(run.journal.steps_in_view(k))
        moments += [RunMoment(step=int(step), why=f"first sees pedestrian {k + 1}") for step in seen[:1]]
    return [*moments, RunMoment(step=0, why="start")]
