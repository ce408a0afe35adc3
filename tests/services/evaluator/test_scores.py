import dataclasses
import json

import pytest

from readygo.common.episode import Conduct, Contact
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.services.evaluator import Category, EpisodeRecord, Task
from readygo.services.evaluator.scores import (
    COLLISION_TIME_MAX_S,
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


def test_faults_and_contacts_are_told_apart():
    """Contacts at which the robot stood, or saw nobody, are none of its fault."""
    contacts = [
        HIT,
        Contact(robot_mps=0.0, in_view=True, seen_s=0.7),
        Contact(robot_mps=0.6, in_view=False, seen_s=0.0),
        None,
        None,
    ]
    outcomes = [*[Outcome.HUMAN_COLLISION] * 3, Outcome.STATIC_COLLISION, Outcome.SUCCESS]
    records = [
        record("policy", index, outcome, duration_s=3.0 + index, contact=contact, intrusion_s=0.5 * index)
        for index, (outcome, contact) in enumerate(zip(outcomes, contacts, strict=True))
    ]
    scores = scores_of(records, time_limit_s=20.0)[Task.DYNAMIC, "policy"]
    at_fault = [contact.at_fault for contact in contacts if contact]
    assert scores["at_fault"].mean == pytest.approx(sum(at_fault) / 5)
    assert scores["not_at_fault"].mean == pytest.approx((3 - sum(at_fault)) / 5)
    assert scores["human_collision"].mean == pytest.approx(0.6)
    assert scores["static_collision"].mean == pytest.approx(0.2)
    assert scores["timeout"].mean == 0.0
    assert scores["art_s"].mean == pytest.approx((4 * 20 + 7) / 5)
    assert scores["intrusion"].mean == pytest.approx((0 + 0.5 / 4 + 1 / 5 + 1.5 / 6 + 2 / 7) / 5)
    assert (scores["contact_in_view"].mean, scores["contact_in_view"].count) == (pytest.approx(2 / 3), 3)
    assert scores["contact_moving"].mean == pytest.approx(2 / 3)
    assert scores["contact_seen_s"].mean == pytest.approx(0.9)
    assert (scores["near_misses"].mean, scores["jerk_mps3"].mean) == (1.0, 2.0)
    assert scores["turn_acceleration_radps2"].mean == 0.5


def test_rates_have_wilsons_interval_and_other_measures_a_bootstraps():
    records = [record("m", k, Outcome.SUCCESS if k < 7 else Outcome.TIMEOUT, duration_s=5.0 + k) for k in range(20)]
    scores = scores_of(records, time_limit_s=60.0)[Task.DYNAMIC, "m"]
    success = scores["success"]
    # Wilson's score interval of 7 of 20 at 95 %.
    p, n, z = 0.35, 20, 1.959964
    middle = (p + z * z / (2 * n)) / (1 + z * z / n)
    half = z / (1 + z * z / n) * (p * (1 - p) / n + z * z / (4 * n * n)) ** 0.5
    assert (success.low, success.high) == pytest.approx((middle - half, middle + half), abs=1e-4)
    times = scores["art_s"]
    deviation = (sum((v - times.mean) ** 2 for v in [*range(5, 12), *[60] * 13]) / 20) ** 0.5 / 20**0.5
    assert times.high - times.low == pytest.approx(2 * 1.96 * deviation, rel=0.15)
    assert times.low < times.mean < times.high


def test_comparison_is_paired_and_signed():
    """The method wins twice where the reference fails, loses once, and is slower where both succeed."""
    ours = [Outcome.SUCCESS] * 5 + [Outcome.TIMEOUT] * 2
    theirs = [Outcome.SUCCESS] * 3 + [Outcome.STATIC_COLLISION] * 2 + [Outcome.SUCCESS, Outcome.TIMEOUT]
    records = [record("ours", k, o, duration_s=10.0 + k) for k, o in enumerate(ours)]
    records += [record("theirs", k, o, duration_s=8.0 + k) for k, o in enumerate(theirs)]
    (compared,) = compare_all([*records, record("theirs", 99, Outcome.SUCCESS)], "theirs", time_limit_s=30.0)
    assert (compared.episodes, compared.only_method, compared.only_reference) == (7, 2, 1)
    assert compared.mcnemar_p == 1.0
    assert compared.differences["success"].mean == pytest.approx(1 / 7)
    assert compared.differences["static_collision"].mean == pytest.approx(-2 / 7)
    # 2 s slower three times, 13 and 14 s in place of 30 s, 30 s in place of 13 s, and both too late.
    expected = (3 * 2 + (13 - 30) + (14 - 30) + (30 - 13) + 0) / 7
    assert compared.differences["art_s"].mean == pytest.approx(expected)
    assert compared.differences["art_s"].low < expected < compared.differences["art_s"].high
    assert compared.success_ratio.mean == pytest.approx(5 / 4)
    assert (compared.time_ratio.mean, compared.time_ratio.count) == (pytest.approx(33 / 27), 3)
    mapping = comparison_mapping(compared)
    assert mapping["only_method"] == 2
    assert mapping["time_ratio"]["mean"] == pytest.approx(33 / 27)


def measured(method, index, too_close_s, collision_time_min_s=None, outcome=Outcome.SUCCESS):
    made = record(method, index, outcome)
    conduct = dataclasses.replace(
        made.result.conduct, too_close_s=too_close_s, collision_time_min_s=collision_time_min_s
    )
    return dataclasses.replace(made, result=dataclasses.replace(made.result, conduct=conduct))


def test_compliance_and_total_are_falcons():
    records = [measured("policy", 0, 2.0, 1.5), measured("policy", 1, 10.0, outcome=Outcome.TIMEOUT)]
    scores = scores_of(records, time_limit_s=50.0)[Task.DYNAMIC, "policy"]
    assert scores["compliance"].mean == pytest.approx((0.8 + 0.0) / 2)
    assert scores["total"].mean == pytest.approx((0.4 + 0.3 * 0.8 + 0.3 * 0.8) / 2)
    assert (scores["collision_time_min_s"].mean, scores["collision_time_min_s"].count) == (1.5, 1)
    slow = scores_of([measured("policy", 0, 2.0, 300.0)], time_limit_s=50.0)[Task.DYNAMIC, "policy"]
    assert slow["collision_time_min_s"].mean == COLLISION_TIME_MAX_S
    assert "compliance" not in scores_of(RECORDS, time_limit_s=50.0)[Task.DYNAMIC, "policy"], "not measured there"


def test_runs_of_one_episode_count_as_their_mean():
    """Policies of two training seeds under one name."""
    records = [
        *(record("policy", index, Outcome.SUCCESS) for index in range(3)),
        *(record("policy", index, Outcome.TIMEOUT) for index in range(2)),
    ]
    success = scores_of(records, time_limit_s=50.0)[Task.DYNAMIC, "policy"]["success"]
    assert (success.mean, success.count) == (pytest.approx(2 / 3), 3)
    assert 0.5 <= success.low < success.high <= 1.0
