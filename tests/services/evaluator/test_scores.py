import json

import pytest

from readygo.common.episode import Conduct, Contact
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.services.evaluator import Category, EpisodeRecord, Task
from readygo.services.evaluator.scores import (
    compare_all,
    comparison_mapping,
    failure_counts,
    score_mapping,
    scores_of,
)


def record(method, index, outcome, duration_s=10.0, contact=None, category=None, intrusion_s=1.0):
    conduct = Conduct(
        intrusion_s=intrusion_s, near_misses=1, jerk_mps3=2.0, turn_acceleration_radps2=0.5, contact=contact
    )
    return EpisodeRecord(
        episode=EpisodeKey(seed=0, split=Split.TEST, index=index),
        task=Task.DYNAMIC,
        method=method,
        result=EpisodeResult(
            outcome=outcome, duration_s=duration_s, path_length_m=5.0, shortest_m=4.0, conduct=conduct
        ),
        human_distance_min_m=1.0,
        category=category,
    )


HIT = Contact(robot_mps=0.5, in_view=True, seen_s=2.0)
RECORDS = [
    *(record("expert", index, Outcome.SUCCESS) for index in range(4)),
    record("policy", 0, Outcome.SUCCESS, duration_s=12.0),
    record("policy", 1, Outcome.SUCCESS, duration_s=14.0),
    record("policy", 2, Outcome.TIMEOUT, category=Category.STUCK),
    record("policy", 3, Outcome.HUMAN_COLLISION, duration_s=5.0, contact=HIT, category=Category.SEEN_HUMAN),
]


def test_measures_are_means_with_intervals_around_them():
    scores = scores_of(RECORDS, time_limit_s=50.0)[Task.DYNAMIC, "policy"]
    assert scores["success"].mean == 0.5
    assert 0.0 < scores["success"].low < 0.5 < scores["success"].high < 1.0
    assert scores["art_s"].mean == pytest.approx((12 + 14 + 50 + 50) / 4)
    assert scores["spl"].mean == pytest.approx(0.5 * 0.8)
    assert scores["human_collision"].mean == scores["at_fault"].mean == 0.25
    assert scores["not_at_fault"].mean == 0.0
    assert scores["intrusion"].mean == pytest.approx((1 / 12 + 1 / 14 + 1 / 10 + 1 / 5) / 4)
    assert (scores["contact_seen_s"].mean, scores["contact_seen_s"].count) == (2.0, 1)
    assert "contact_seen_s" not in scores_of(RECORDS[:4], time_limit_s=50.0)[Task.DYNAMIC, "expert"]


def test_methods_are_compared_on_the_episodes_that_both_drove():
    (compared,) = compare_all(RECORDS[1:], "expert", time_limit_s=50.0)
    assert (compared.method, compared.reference, compared.episodes) == ("policy", "expert", 3)
    assert (compared.only_method, compared.only_reference) == (0, 2)
    assert compared.mcnemar_p == 0.5
    assert compared.differences["success"].mean == pytest.approx(-2 / 3)
    assert compared.success_ratio.mean == pytest.approx(1 / 3)
    assert (compared.time_ratio.mean, compared.time_ratio.count) == (pytest.approx(1.4), 1)


def test_failures_are_counted_by_kind():
    counts = failure_counts(RECORDS)
    assert counts[Task.DYNAMIC, "policy"] == {Category.STUCK: 1, Category.SEEN_HUMAN: 1}
    assert not counts[Task.DYNAMIC, "expert"]


def test_all_of_it_is_json_without_nan():
    lost = [record("lost", index, Outcome.TIMEOUT) for index in range(4)]
    compared = compare_all([*lost, *RECORDS[4:]], "lost", time_limit_s=50.0)
    text = json.dumps([comparison_mapping(each) for each in compared], allow_nan=False)
    assert '"success_ratio": {"mean": null' in text
    json.dumps(score_mapping(scores_of(RECORDS, time_limit_s=50.0)), allow_nan=False)
