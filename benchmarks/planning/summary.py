"""What the planning benchmark says of its runs: numbers per map, task and mode, and a table of them."""

import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from readygo.benchmarks.planning.runs import Draw, PlanningJob, PlanningRun
from readygo.common.episode import EpisodeConfig, summarize
from readygo.common.episode.conduct import NEAR_MISS_M
from readygo.common.robot import RobotConfig

COLUMNS = (15, 5, 5, 4, 14, 10, 5, 5, 5)
LEGEND = (
    f"near: runs without collision, but with less than {NEAR_MISS_M} m between robot and human",
    "replan, episode: CPU time [ms]; episode is scenario (rejected draws included) + expert, ep/s its inverse per core",
    "|dw|: mean change of the turn rate [rad/s per s]; m/s: mean speed where walls and people leave room",
)


def rows_of(job: PlanningJob, drawn: Sequence[Draw]) -> list[dict[str, Any]]:
    """One row per task and mode; keys carry units, `_ms` and `_core_s` ones are CPU time."""
    accepted = [draw for draw in drawn if not draw.rejected]
    scenario_ms = sum(draw.scenario_ms for draw in drawn) / len(accepted)
    rows = []
    for task in job.tasks:
        for mode in job.modes:
            runs = [draw.runs[task, mode] for draw in accepted]
            rows.append({"map": job.source.name, "task": task, "mode": mode, **row_of(runs, scenario_ms)})
    return rows


def row_of(runs: Sequence[PlanningRun], scenario_ms: float) -> dict[str, Any]:
    """Numbers of one mode in one task."""
    contact_m = RobotConfig().radius_m + EpisodeConfig().human_radius_m
    score = asdict(summarize([run.result for run in runs], time_limit_s=EpisodeConfig().time_limit_s))
    replans_ms = [ms for run in runs for ms in run.replan_ms] or [math.nan]
    expert_ms = sum(run.expert_ms for run in runs) / len(runs)
    gaps_m = [run.avatar_gap_m for run in runs if run.avatar_gap_m is not None and math.isfinite(run.avatar_gap_m)]
    free_s, duration_s = sum(run.free_s for run in runs), sum(run.result.duration_s for run in runs)
    return {
        **{key: round(value, 4) for key, value in score.items()},
        "near_misses": sum(contact_m <= run.closest_m < contact_m + NEAR_MISS_M for run in runs),
        "avatar_gap_p5_m": _round_values(np.percentile(gaps_m, 5)) if gaps_m else None,
        "replans_per_episode": round(sum(len(run.replan_ms) for run in runs) / len(runs), 2),
        "replan_p50_ms": _round_values(np.percentile(replans_ms, 50)),
        "replan_p99_ms": _round_values(np.percentile(replans_ms, 99)),
        "expert_ms": round(expert_ms, 2),
        "scenario_ms": round(scenario_ms, 2),
        "episodes_per_core_s": round(1e3 / (scenario_ms + expert_ms), 1),
        "turn_change_radps2": _round_values(sum(run.turn_change_radps for run in runs) / duration_s),
        "free_speed_mps": _round_values(sum(run.free_m for run in runs) / free_s) if free_s > 0 else None,
        "failures": dict(Counter(run.failure for run in runs if run.failure).most_common()),
    }


def map_row(job: PlanningJob, drawn: Sequence[Draw]) -> dict[str, Any]:
    """What was drawn on a map, independent of the experts' results."""
    accepted = [draw for draw in drawn if not draw.rejected]
    return {
        "map": job.source.name,
        "file": Path(job.source.path).name,
        "draws": len(drawn),
        "rejected": dict(Counter(draw.rejected for draw in drawn if draw.rejected).most_common()),
        "motion_ms": round(sum(draw.motion_ms for draw in accepted) / len(accepted), 1),
    }


def text(result: dict[str, Any]) -> str:
    """The result for people."""
    head = f"{result['episodes']} test episodes per map, seed {result['seed']}, people: {result['people']}"
    lines = [head, *LEGEND]
    for place in result["maps"]:
        rejected = ", ".join(f"{count} {reason}" for reason, count in place["rejected"].items()) or "none"
        lines.append(f"\n{place['map']}: {place['draws']} draws, rejected: {rejected}")
        rows = [row for row in result["rows"] if row["map"] == place["map"]]
        for task in dict.fromkeys(row["task"] for row in rows):
            lines += _task_lines(task, [row for row in rows if row["task"] == task])
    return "\n".join(lines) + "\n"


def _task_lines(task: str, rows: list[dict[str, Any]]) -> list[str]:
    width = max(len(task), *(len(row["mode"]) for row in rows))
    head = ("SR % (95 %)", "ART s", "SPL", "near", "replan p50/p99", "episode ms", "ep/s", "|dw|", "m/s")
    table = [[task.ljust(width), *(text.rjust(n) for text, n in zip(head, COLUMNS, strict=True))]]
    table += [
        [row["mode"].ljust(width), *(c.rjust(n) for c, n in zip(_cells(row), COLUMNS, strict=True))] for row in rows
    ]
    return ["  ".join(cells) for cells in table] + [note for row in rows for note in _notes(row)]


def _cells(row: dict[str, Any]) -> list[str]:
    low, high = (100 * row[f"success_rate_{end}"] for end in ("low", "high"))
    return [
        f"{100 * row['success_rate']:.1f} ({low:.0f}-{high:.0f})",
        f"{row['art_s']:.1f}",
        f"{row['spl']:.3f}",
        "-" if row["task"] == "static" else f"{row['near_misses']}",
        f"{_number(row['replan_p50_ms'], 2)} / {_number(row['replan_p99_ms'], 1)}",
        f"{row['scenario_ms']:.0f} + {row['expert_ms']:.0f}",
        f"{row['episodes_per_core_s']:.1f}",
        _number(row["turn_change_radps2"], 2),
        _number(row["free_speed_mps"], 2),
    ]


def _number(value: float | None, digits: int) -> str:
    return "-" if value is None else f"{value:.{digits}f}"


def _notes(row: dict[str, Any]) -> list[str]:
    notes = []
    if row["failures"]:
        notes.append(f"  {row['mode']} failed: " + ", ".join(f"{n} {name}" for name, n in row["failures"].items()))
    if row["avatar_gap_p5_m"] is not None:
        gap = f"{100 * row['avatar_gap_p5_m']:.0f} cm"
        notes.append(f"  {row['mode']}: 5 % of its runs come nearer than {gap} to an avatar's Gaussians")
    return notes


def _round_values(value: float) -> float | None:
    return round(float(value), 3) if math.isfinite(value) else None
