"""What happened in an episode, in figures: plain values, None for what is not there."""

import math
from typing import Any

import numpy as np

from readygo.common.arrays import BoolArray
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.messages import Scenario
from readygo.services.planner.explain.journal import DrivenRun

Numbers = dict[str, Any]


def scenario_numbers(scenario: Scenario) -> Numbers:
    """What was planned: start, goal, and who walks."""
    start, goal = scenario.start_xyyaw.tolist(), scenario.goal_xy_m.tolist()
    return {
        "start_xyyaw": [round(value, 4) for value in start],
        "goal_xy_m": [round(value, 4) for value in goal],
        "goal_distance_m": round(math.hypot(goal[0] - start[0], goal[1] - start[1]), 3),
        "humans": [
            {"avatar": human.avatar, "encounter": human.encounter, "speed_mps": round(human.speed_mps, 3)}
            for human in scenario.humans
        ],
    }


def run_numbers(run: DrivenRun) -> Numbers:
    """What was planned, how the robot was driven, how near each human came and when it was seen."""
    numbers = scenario_numbers(run.scenario)
    humans = [{**human, **_encounter_numbers(run, k)} for k, human in enumerate(numbers["humans"])]
    return {**numbers, **_drive_numbers(run), "humans": humans}


def _encounter_numbers(run: DrivenRun, human: int) -> Numbers:
    gap_m = run.gap_m(human)
    closest, dt_s = int(np.argmin(gap_m)), run.trajectory.dt_s
    return {
        "closest_m": round(float(gap_m[closest]), 3),
        "closest_s": round(closest * run.trajectory.dt_s, 2),
        "visible_s": [[round(a * dt_s, 2), round(b * dt_s, 2)] for a, b in spans(run.journal.steps_in_view(human))],
    }


def _drive_numbers(run: DrivenRun) -> Numbers:
    trajectory = run.trajectory
    return {
        "outcome": trajectory.outcome.value,
        "duration_s": round(trajectory.duration_s, 2),
        "path_length_m": round(EpisodeResult.from_trajectory(trajectory, 0.0).path_length_m, 3),
        **(_plan_numbers(run) if run.explained else {}),
        "human_distance_min_m": _finite(float(trajectory.human_distance_m.min())),
        "time_to_collision_min_s": _finite(float(trajectory.time_to_collision_s.min())),
        "human_visible_share": round(float(trajectory.human_visible.mean()), 3),
    }


def _plan_numbers(run: DrivenRun) -> Numbers:
    times_ms = 1e3 * run.trajectory.replan_times_s
    return {
        "replans": int(run.trajectory.replanned.sum()),
        "paths": len(run.journal.changes),
        "replan_p50_ms": round(float(np.percentile(times_ms, 50)), 3) if len(times_ms) else None,
        "replan_p99_ms": round(float(np.percentile(times_ms, 99)), 3) if len(times_ms) else None,
    }


def spans(flags: BoolArray) -> list[tuple[int, int]]:
    """Begin and end of the stretches of True; the end is the first False behind."""
    edges = np.flatnonzero(np.diff(np.concatenate([[0], flags.astype(np.int8), [0]])))
    return [(int(a), int(b)) for a, b in zip(edges[::2], edges[1::2], strict=True)]


def _finite(value: float) -> float | None:
    return round(value, 3) if math.isfinite(value) else None
