"""Results of an evaluation, as records and tables."""

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from rich import box
from rich.table import Table

from readygo.common.config import section_from_mapping
from readygo.common.episode import Conduct, EpisodeSimulation
from readygo.common.episode.conduct import Sees, conduct_of
from readygo.common.episode.metrics import EpisodeResult, TaskSummary, summarize
from readygo.common.errors import ConfigError
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.common.messages.live import LiveEvaluation
from readygo.services.evaluator.categories import Category, category_of
from readygo.services.evaluator.drivers import short_name
from readygo.services.evaluator.episodes import MatchedEpisode, Task

RecordKey = tuple[Task, str, EpisodeKey]
"""Which record of an evaluation: task, method, episode."""


@dataclass(frozen=True, kw_only=True)
class EpisodeRecord:
    """How one method did in one episode."""

    episode: EpisodeKey
    task: Task
    method: str
    result: EpisodeResult
    human_distance_min_m: float
    """Smallest distance of the centres of robot and any human where the robot decided [m], so without the last state;
    inf without humans."""
    category: Category | None = None
    """Kind of failure; None after a success, or if none was noted."""
    reason: str = ""
    """Why its driver failed."""

    @property
    def key(self) -> RecordKey:
        """Key of the record: task, method and episode."""
        return self.task, self.method, self.episode

    def to_mapping(self) -> dict[str, Any]:
        """Plain values, as in a line of `episodes.jsonl`; a distance that is not there is None."""
        return {
            "episode": self.episode.episode_id,
            "seed": self.episode.seed,
            "split": self.episode.split.value,
            "index": self.episode.index,
            "task": self.task.value,
            "method": self.method,
            "outcome": self.result.outcome.value,
            "duration_s": round(self.result.duration_s, 6),
            "path_length_m": round(self.result.path_length_m, 6),
            "shortest_m": _finite(self.result.shortest_m),
            "human_distance_min_m": _finite(self.human_distance_min_m),
            **({"conduct": _round_conduct(self.result.conduct)} if self.result.conduct else {}),
            **({"category": self.category.name.lower()} if self.category else {}),
            **({"reason": self.reason} if self.reason else {}),
        }


def shown_record(record: EpisodeRecord, policy: str = "") -> LiveEvaluation:
    """A record as watchers hear of it.

    Args:
        record: How an episode ended.
        policy: SHA-256 over the files of the policy that was measured; empty for a baseline.
    """
    return LiveEvaluation(
        episode=record.episode,
        task=record.task.value,
        method=record.method,
        policy=policy,
        outcome=record.result.outcome,
        duration_s=record.result.duration_s,
    )


def record_of_mapping(mapping: Mapping[str, Any]) -> EpisodeRecord:
    """The record of which `EpisodeRecord.to_mapping` gave the plain values.

    Raises:
        ValueError: If a value is missing, or none that a record has.
    """
    try:
        return EpisodeRecord(
            episode=EpisodeKey(
                seed=_integer(mapping, "seed"), split=Split(mapping["split"]), index=_integer(mapping, "index")
            ),
            task=Task(mapping["task"]),
            method=str(mapping["method"]),
            result=EpisodeResult(
                outcome=Outcome(mapping["outcome"]),
                duration_s=_measured(mapping, "duration_s"),
                path_length_m=_measured(mapping, "path_length_m"),
                shortest_m=_measured_or_infinite(mapping, "shortest_m"),
                conduct=_conduct(mapping["conduct"]) if "conduct" in mapping else None,
            ),
            human_distance_min_m=_measured_or_infinite(mapping, "human_distance_min_m"),
            category=Category[str(mapping["category"]).upper()] if "category" in mapping else None,
            reason=str(mapping.get("reason", "")),
        )
    except (KeyError, TypeError, AttributeError, ConfigError) as error:
        raise ValueError(f"{type(error).__name__}: {error}") from error


def make_record(
    episode: MatchedEpisode, method: str, simulation: EpisodeSimulation, sees: Sees, failure: str = ""
) -> EpisodeRecord:
    """The record of a run.

    Args:
        episode: What was driven through.
        method: Who drove.
        simulation: The episode, ended.
        sees: Whether the robot's camera shows a human.
        failure: Why the driver gave up; empty if it did not.
    """
    trajectory = simulation.trajectory()
    conduct = conduct_of(
        simulation.path_xyyaw(0, simulation.step),
        trajectory.actions,
        np.array([simulation.human_xy_at(step) for step in range(simulation.step + 1)]),
        dt_s=simulation.clock.dt_s,
        contact_m=simulation.contact_m,
        sees=sees,
    )
    result = EpisodeResult.from_trajectory(trajectory, episode.shortest_m)
    record = EpisodeRecord(
        episode=episode.scenario.episode,
        task=episode.task,
        method=method,
        result=dataclasses.replace(result, conduct=conduct),
        human_distance_min_m=min(trajectory.human_distance_m.tolist(), default=math.inf),
        category=category_of(simulation, conduct.contact, failure),
        reason=failure,
    )
    # Rounded as it is stored: an evaluation that resumes from a folder gets the same scores to the last digit.
    return record_of_mapping(record.to_mapping())


def summarize_records(records: Sequence[EpisodeRecord], *, time_limit_s: float) -> dict[tuple[Task, str], TaskSummary]:
    """Scores by task and method, in the order in which they first appear."""
    groups: dict[tuple[Task, str], list[EpisodeResult]] = {}
    for record in records:
        groups.setdefault((record.task, record.method), []).append(record.result)
    return {group: summarize(results, time_limit_s=time_limit_s) for group, results in groups.items()}


def summary_mapping(summaries: dict[tuple[Task, str], TaskSummary]) -> dict[str, dict[str, dict[str, float | int]]]:
    """Scores as plain values: task -> method -> measure."""
    mapping: dict[str, dict[str, dict[str, float | int]]] = {}
    for (task, method), summary in summaries.items():
        mapping.setdefault(task.value, {})[method] = dataclasses.asdict(summary)
    return mapping


def summary_table(summaries: dict[tuple[Task, str], TaskSummary]) -> Table:
    """Scores for people to read, 80 columns wide: success rate and its interval, collisions by kind, timeouts."""
    counts = max(summary.episode_count for summary in summaries.values())
    table = Table(
        title=f"Closed loop, {counts} matched episodes per task",
        box=box.SIMPLE_HEAD,
        padding=(0, 1, 0, 0),
        pad_edge=False,
    )
    table.add_column("task", no_wrap=True)
    table.add_column("method", no_wrap=True)
    for name in ("SR %", "95 %", "ART s", "SPL", "wall %", "human %", "late %"):
        table.add_column(name, justify="right", no_wrap=True)
    for (task, method), summary in summaries.items():
        table.add_row(
            task.value,
            short_name(method),
            f"{100 * summary.success_rate:.1f}",
            f"{100 * summary.success_rate_low:.0f}-{100 * summary.success_rate_high:.0f}",
            f"{summary.art_s:.1f}",
            f"{summary.spl:.3f}",
            f"{100 * summary.static_collision_rate:.1f}",
            f"{100 * summary.human_collision_rate:.1f}",
            f"{100 * summary.timeout_rate:.1f}",
        )
    return table


def _round_conduct(conduct: Conduct) -> dict[str, Any]:
    mapping: dict[str, Any] = dataclasses.asdict(conduct)
    contact = mapping.pop("contact")
    return {
        **{name: round(value, 6) for name, value in mapping.items() if value is not None},
        **({"contact": {k: round(v, 6) if isinstance(v, float) else v for k, v in contact.items()}} if contact else {}),
    }


def _integer(mapping: Mapping[str, Any], name: str) -> int:
    value = mapping[name]
    if type(value) is not int:
        raise ValueError(f"{name} must be a whole number, got {value!r}")
    return value


def _measured(mapping: Mapping[str, Any], name: str) -> float:
    """A finite number that is not negative, as all times and distances of a record are."""
    value = mapping[name]
    if isinstance(value, bool) or not isinstance(value, int | float) or not (math.isfinite(value) and value >= 0):
        raise ValueError(f"{name} must be a finite number of at least 0, got {value!r}")
    return float(value)


def _measured_or_infinite(mapping: Mapping[str, Any], name: str) -> float:
    return math.inf if mapping[name] is None else _measured(mapping, name)


def _conduct(mapping: Mapping[str, Any]) -> Conduct:
    conduct = section_from_mapping(Conduct, mapping)
    for name in mapping.keys() - {"contact"}:
        _measured_or_infinite(mapping, name)
    return conduct


def _finite(value: float) -> float | None:
    return round(value, 6) if math.isfinite(value) else None
