"""Scores of methods with their intervals, and methods beside each other on the same episodes."""

import dataclasses
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.episode import wilson_interval
from readygo.common.episode.metrics import EpisodeResult, spl_of
from readygo.common.messages import EpisodeKey, Outcome
from readygo.services.evaluator.categories import Category
from readygo.services.evaluator.episodes import Task
from readygo.services.evaluator.records import EpisodeRecord
from readygo.services.evaluator.statistics import bootstrap_interval, mcnemar_p

Group = tuple[Task, str]
"""Task and method."""
COLLISION_TIME_MAX_S = 10.0
"""Longer times to collision count as this [s]: a mean must not depend on how slowly two nearly parallel ways meet."""
Value = Callable[[EpisodeResult, float], float | None]
"""A measure of one episode, given the time limit [s]; None where it has none."""


@dataclass(frozen=True, kw_only=True)
class Measure:
    """One quantity that is measured in every episode."""

    name: str
    title: str
    unit: Literal["%", "% of time", "s", "", "m/s3", "rad/s2"]
    """"%" is a share of episodes."""
    better: Literal["high", "low"]
    value: Value


def _share_ending(outcome: Outcome) -> Value:
    return lambda result, _: float(result.outcome is outcome)


def _fault(at_fault: bool) -> Value:
    def value(result: EpisodeResult, _: float) -> float | None:
        if result.conduct is None:
            return None
        contact = result.conduct.contact
        return float(contact is not None and contact.at_fault is at_fault)

    return value


def _conduct(name: str) -> Value:
    def value(result: EpisodeResult, _: float) -> float | None:
        measured = None if result.conduct is None else getattr(result.conduct, name)
        return None if measured is None else float(measured)

    return value


def _reaching_s(result: EpisodeResult, time_limit_s: float) -> float:
    return result.duration_s if result.outcome is Outcome.SUCCESS else time_limit_s


def _intrusion(result: EpisodeResult, _: float) -> float | None:
    if result.conduct is None:
        return None
    return result.conduct.intrusion_s / result.duration_s if result.duration_s > 0 else 0.0


def _compliance(result: EpisodeResult, _: float) -> float | None:
    if result.conduct is None or result.conduct.too_close_s is None:
        return None
    return 1.0 - result.conduct.too_close_s / result.duration_s if result.duration_s > 0 else 1.0


def _collision_time(result: EpisodeResult, _: float) -> float | None:
    shortest_s = None if result.conduct is None else result.conduct.collision_time_min_s
    return None if shortest_s is None else min(shortest_s, COLLISION_TIME_MAX_S)


def _total(result: EpisodeResult, time_limit_s: float) -> float | None:
    """Falcon's total of success, path efficiency and compliance. Source: Gong et al., arXiv:2409.13244."""
    compliance = _compliance(result, time_limit_s)
    if compliance is None:
        return None
    return 0.4 * float(result.outcome is Outcome.SUCCESS) + 0.3 * spl_of(result) + 0.3 * compliance


def _contact(name: str) -> Value:
    def value(result: EpisodeResult, _: float) -> float | None:
        contact = result.conduct.contact if result.conduct else None
        return None if contact is None else float(getattr(contact, name))

    return value


MEASURES = (
    Measure(name="success", title="SR", unit="%", better="high", value=_share_ending(Outcome.SUCCESS)),
    Measure(name="art_s", title="ART", unit="s", better="low", value=_reaching_s),
    Measure(name="spl", title="SPL", unit="", better="high", value=lambda result, _: spl_of(result)),
    Measure(
        name="static_collision",
        title="Hit a thing",
        unit="%",
        better="low",
        value=_share_ending(Outcome.STATIC_COLLISION),
    ),
    Measure(
        name="human_collision",
        title="Hit a human",
        unit="%",
        better="low",
        value=_share_ending(Outcome.HUMAN_COLLISION),
    ),
    Measure(name="at_fault", title="Robot's fault", unit="%", better="low", value=_fault(True)),
    Measure(name="not_at_fault", title="Not its fault", unit="%", better="low", value=_fault(False)),
    Measure(name="timeout", title="Too late", unit="%", better="low", value=_share_ending(Outcome.TIMEOUT)),
    Measure(name="intrusion", title="Personal space", unit="% of time", better="low", value=_intrusion),
    Measure(name="compliance", title="PSC", unit="% of time", better="high", value=_compliance),
    Measure(name="total", title="Total", unit="", better="high", value=_total),
    Measure(
        name="collision_time_min_s",
        title="Least time to collision",
        unit="s",
        better="high",
        value=_collision_time,
    ),
    Measure(name="near_misses", title="Near misses", unit="", better="low", value=_conduct("near_misses")),
    Measure(name="jerk_mps3", title="Jerk", unit="m/s3", better="low", value=_conduct("jerk_mps3")),
    Measure(
        name="turn_acceleration_radps2",
        title="Turn acceleration",
        unit="rad/s2",
        better="low",
        value=_conduct("turn_acceleration_radps2"),
    ),
    Measure(name="contact_moving", title="Contacts: it moved", unit="%", better="low", value=_contact("robot_moved")),
    Measure(name="contact_in_view", title="Contacts: in view", unit="%", better="low", value=_contact("in_view")),
    Measure(name="contact_seen_s", title="Contacts: seen before", unit="s", better="low", value=_contact("seen_s")),
)
"""All measures, in the order in which they are shown. The last three are means over the contacts alone."""


@dataclass(frozen=True, kw_only=True)
class Score:
    """A mean over episodes, with its 95 % interval: Wilson's for rates, else a bootstrap's."""

    mean: float
    low: float
    high: float
    count: int
    """Episodes that it is the mean of."""


@dataclass(frozen=True, kw_only=True)
class Comparison:
    """Two methods on the same episodes of a task, one run of each."""

    task: Task
    method: str
    reference: str
    episodes: int
    only_method: int
    """Episodes in which only the method succeeded."""
    only_reference: int
    mcnemar_p: float
    """Two-sided p-value of McNemar's exact test on the successes."""
    differences: Mapping[str, Score]
    """Method minus reference by measure, paired bootstrap."""
    success_ratio: Score
    """Success rate over the reference's, paired bootstrap."""
    time_ratio: Score
    """Mean time over the reference's, of the episodes in which both succeeded."""


COMPARED = (
    *("success", "art_s", "spl", "human_collision", "static_collision", "intrusion"),
    *("compliance", "total", "collision_time_min_s", "jerk_mps3"),
)
"""Measures whose differences are told."""


def scores_of(records: Sequence[EpisodeRecord], *, time_limit_s: float) -> dict[Group, dict[str, Score]]:
    """All measures by task and method; those that no episode has are left out.

    Several records of an episode, by policies of several training seeds under one name, count as their mean.
    """
    return {
        group: {
            measure.name: score
            for measure in MEASURES
            if (score := _score(measure, _runs_by_episode(of_group), time_limit_s)) is not None
        }
        for group, of_group in group_records(records).items()
    }


def group_records(records: Sequence[EpisodeRecord]) -> dict[Group, list[EpisodeRecord]]:
    """Records by task and method, in the order in which these first appear."""
    groups: dict[Group, list[EpisodeRecord]] = {}
    for record in records:
        groups.setdefault((record.task, record.method), []).append(record)
    return groups


def compare_all(records: Sequence[EpisodeRecord], reference: str, *, time_limit_s: float) -> list[Comparison]:
    """Every method beside a reference, task by task, on the episodes that both drove."""
    groups = group_records(records)
    return [
        _compare(of_group, groups[task, reference], time_limit_s)
        for (task, method), of_group in groups.items()
        if method != reference and (task, reference) in groups
    ]


def failure_counts(records: Sequence[EpisodeRecord]) -> dict[Group, Counter[Category]]:
    """How often each group fails in which way."""
    return {
        group: Counter(record.category for record in of_group if record.category is not None)
        for group, of_group in group_records(records).items()
    }


def score_mapping(scores: Mapping[Group, Mapping[str, Score]]) -> dict[str, dict[str, dict[str, Any]]]:
    """Scores as plain values: task -> method -> measure."""
    mapping: dict[str, dict[str, dict[str, Any]]] = {}
    for (task, method), by_name in scores.items():
        mapping.setdefault(task.value, {})[method] = {name: _plain(score) for name, score in by_name.items()}
    return mapping


def comparison_mapping(comparison: Comparison) -> dict[str, Any]:
    """A comparison as plain values."""
    return {
        "task": comparison.task.value,
        "method": comparison.method,
        "reference": comparison.reference,
        "episodes": comparison.episodes,
        "only_method": comparison.only_method,
        "only_reference": comparison.only_reference,
        "mcnemar_p": comparison.mcnemar_p,
        "differences": {name: _plain(score) for name, score in comparison.differences.items()},
        "success_ratio": _plain(comparison.success_ratio),
        "time_ratio": _plain(comparison.time_ratio),
    }


def _runs_by_episode(records: Sequence[EpisodeRecord]) -> list[list[EpisodeResult]]:
    """The results of each episode."""
    runs: dict[EpisodeKey, list[EpisodeResult]] = {}
    for record in records:
        runs.setdefault(record.episode, []).append(record.result)
    return list(runs.values())


def _score(measure: Measure, episodes: Sequence[Sequence[EpisodeResult]], time_limit_s: float) -> Score | None:
    by_episode = [
        [value for result in runs if (value := measure.value(result, time_limit_s)) is not None] for runs in episodes
    ]
    found = [math.fsum(values) / len(values) for values in by_episode if values]
    if not found:
        return None
    mean = math.fsum(found) / len(found)
    if measure.unit == "%" and all(len(runs) == 1 for runs in episodes):
        low, high = wilson_interval(round(math.fsum(found)), len(found))
    else:
        low, high = bootstrap_interval(np.array(found)[:, None])
    return Score(mean=mean, low=low, high=high, count=len(found))


def _compare(records: Sequence[EpisodeRecord], others: Sequence[EpisodeRecord], time_limit_s: float) -> Comparison:
    theirs: Mapping[EpisodeKey, EpisodeRecord] = {record.episode: record for record in others}
    pairs = [(record.result, theirs[record.episode].result) for record in records if record.episode in theirs]
    won = np.array([[float(result.outcome is Outcome.SUCCESS) for result in pair] for pair in pairs]).reshape(-1, 2)
    times = np.array([[result.duration_s for result in pair] for pair in pairs]).reshape(-1, 2)[won.all(axis=1)]
    only_method, only_reference = (int(np.count_nonzero(won[:, k] > won[:, 1 - k])) for k in (0, 1))
    return Comparison(
        task=records[0].task,
        method=records[0].method,
        reference=others[0].method,
        episodes=len(pairs),
        only_method=only_method,
        only_reference=only_reference,
        mcnemar_p=mcnemar_p(only_method, only_reference),
        differences={
            measure.name: score
            for measure in MEASURES
            if measure.name in COMPARED and (score := _difference(measure, pairs, time_limit_s)) is not None
        },
        success_ratio=_ratio(won),
        time_ratio=_ratio(times),
    )


def _difference(
    measure: Measure, pairs: Sequence[tuple[EpisodeResult, EpisodeResult]], time_limit_s: float
) -> Score | None:
    values = [[measure.value(result, time_limit_s) for result in pair] for pair in pairs]
    found = np.array([ours - theirs for ours, theirs in values if ours is not None and theirs is not None])
    if not len(found):
        return None
    low, high = bootstrap_interval(found[:, None])
    return Score(mean=float(found.mean()), low=low, high=high, count=len(found))


def _ratio(columns: Float64Array) -> Score:
    """Mean of the first column over that of the second one; NaN where that is nothing."""
    ours, theirs = columns.mean(axis=0).tolist() if len(columns) else (math.nan, math.nan)
    low, high = bootstrap_interval(columns, lambda means: means[:, 0] / means[:, 1])
    return Score(mean=ours / theirs if theirs else math.nan, low=low, high=high, count=len(columns))


def _plain(score: Score) -> dict[str, Any]:
    """Numbers for JSON, which has no NaN."""
    plain = dataclasses.asdict(score)
    return {name: None if isinstance(value, float) and math.isnan(value) else value for name, value in plain.items()}
