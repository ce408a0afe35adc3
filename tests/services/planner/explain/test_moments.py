"""Which moments explain a run."""

import numpy as np

from readygo.common.messages import Outcome
from readygo.services.planner.explain.moments import RunMoment, pick_moments
from tests.services.planner.runs import STEPS, WAY, make_journal, make_run

NEAR, FAR = [(0.0, 5.3)], [(0.0, 9.0)]


def words(run):
    return [(moment.step, moment.why) for moment in pick_moments(run)]


def journal(*, seen=None, change=None):
    paths = [(WAY if change is None or k < change else WAY + np.array([0.0, 1.0]))[k:] for k in range(STEPS)]
    return make_journal(paths, searches=(0, change), seen=seen)


def test_run_without_humans_shows_its_start():
    assert words(make_run()) == [(0, "start")]


def test_encounter_shows_first_sight_change_and_closest_approach_in_order():
    seen = {k: (0.0, 5.3) for k in range(12, 60)}
    run = make_run(NEAR, journal=journal(seen=seen, change=25))
    # Row 39 is the first of the two that are nearest to x = 0.
    assert words(run) == [(12, "first sees pedestrian 1"), (25, "takes another path"), (39, "closest to pedestrian 1")]


def test_change_without_a_human_in_mind_is_not_shown():
    assert (25, "takes another path") not in words(make_run(NEAR, journal=journal(change=25)))


def test_human_far_away_is_not_approached():
    assert words(make_run(FAR)) == [(0, "start")]


def test_failure_is_always_shown_last():
    for outcome in (Outcome.HUMAN_COLLISION, Outcome.STATIC_COLLISION, Outcome.TIMEOUT):
        last = pick_moments(make_run(NEAR, outcome=outcome))[-1]
        assert last == RunMoment(step=STEPS - 1, why=outcome.value.replace("_", " "))


def test_moments_are_at_least_half_a_second_apart():
    seen = {k: (0.0, 5.3) for k in range(35, 60)}
    assert words(make_run(NEAR, journal=journal(seen=seen))) == [(0, "start"), (39, "closest to pedestrian 1")]


def test_second_person_who_comes_nearer_is_the_one_that_is_shown_and_seen_first():
    seen = {k: (0.0, 5.3) for k in range(30, 60)}
    run = make_run([(-1.0, 6.4)], [(1.0, 5.2)], journal=journal(seen=seen, change=22))
    shown = words(run)
    assert shown[-1] == (int(np.argmin(np.abs(WAY[:, 0] - 1.0))), "closest to pedestrian 2")
    assert (30, "first sees pedestrian 1") in shown
    assert len(shown) == 3


def test_three_meters_are_near_and_half_a_second_is_apart():
    assert words(make_run([(0.0, 4.6 + 2.99)]))[-1][1] == "closest to pedestrian 1"
    assert words(make_run([(0.0, 4.6 + 3.01)])) == [(0, "start")]
    for first, shown in ((29, True), (30, False)):
        seen = {k: (0.0, 5.3) for k in range(first, 60)}
        assert ((first, "first sees pedestrian 1") in words(make_run(NEAR, journal=journal(seen=seen)))) is shown
