import math

import pytest

from readygo.apps.evaluation.choice import check_wanted, filmed, watched_method
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.services.evaluator import EXPERT, POLICY, STRAIGHT_LINE, EpisodeRecord, Task


def record(index, outcome, near_m=math.inf, task=Task.DYNAMIC):
    result = EpisodeResult(outcome=outcome, duration_s=3.0, path_length_m=1.0, shortest_m=1.0)
    key = EpisodeKey(seed=0, split=Split.TEST, index=index)
    return EpisodeRecord(episode=key, task=task, method=POLICY, result=result, human_distance_min_m=near_m)


RECORDS = [
    record(0, Outcome.SUCCESS, 2.0),
    record(1, Outcome.TIMEOUT, 1.0),
    record(3, Outcome.HUMAN_COLLISION, 0.5),
    record(4, Outcome.SUCCESS, 0.6),
    record(5, Outcome.STATIC_COLLISION),
    record(5, Outcome.SUCCESS, task=Task.STATIC),
]


def indices(*wanted):
    return [each.episode.index for each in filmed(RECORDS, wanted)]


def test_failures_come_by_how_bad_they_are():
    assert indices("failures") == [3, 5, 1]


def test_worst_are_few_and_end_with_the_success_that_came_nearest_to_a_human():
    assert indices("worst") == [3, 5, 1, 4]


def test_index_means_every_task_and_nothing_is_filmed_twice():
    assert indices("5") == [5, 5]
    assert indices("failures", "3", "0") == [3, 5, 1, 0]
    assert indices() == []


def test_what_is_no_episode_is_refused():
    with pytest.raises(RunError, match="index 2: indices without a scenario leave gaps"):
        filmed(RECORDS, ["2"])
    with pytest.raises(RunError, match="'best'"):
        check_wanted(["worst", "17", "best"])
    check_wanted(["worst", "failures", "17"])


def test_policy_is_watched_where_one_drives():
    assert watched_method([EXPERT, POLICY]) == POLICY
    assert watched_method([EXPERT, STRAIGHT_LINE]) == EXPERT
