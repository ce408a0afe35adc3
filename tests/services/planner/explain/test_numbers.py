import dataclasses

import numpy as np
import pytest

from readygo.services.planner.explain.numbers import run_numbers, scenario_numbers, spans
from tests.services.planner.runs import STEPS, WAY, make_journal, make_run, make_scenario

TRACK = [(0.0, 5.6)]


def test_spans_are_the_stretches_of_true():
    assert spans(np.array([True, True, False, True, False, False, True])) == [(0, 2), (3, 4), (6, 7)]
    assert spans(np.zeros(4, np.bool_)) == []


def test_plan_in_numbers():
    numbers = scenario_numbers(make_scenario(TRACK))
    assert numbers["goal_distance_m"] == pytest.approx(4.5)
    assert numbers["start_xyyaw"] == [-2.0, 4.6, 0.0]
    assert numbers["humans"] == [{"avatar": "mia", "encounter": "crossing", "speed_mps": 1.0}]


def test_run_in_numbers_tells_when_a_human_was_nearest_and_seen():
    seen = {k: (0.0, 5.6) for k in range(10, 30)}
    journal = make_journal([WAY[k:] for k in range(STEPS)], searches=(0, 40), seen=seen)
    numbers = run_numbers(make_run(TRACK, journal=journal))
    (human,) = numbers["humans"]
    assert human["closest_m"] == pytest.approx(1.0, abs=1e-3)
    assert human["closest_s"] == pytest.approx(0.05 * np.argmin(np.abs(WAY[:, 0])))
    assert human["visible_s"] == [[0.5, 1.5]]
    assert numbers["outcome"] == "success"
    assert numbers["paths"] == 1
    assert numbers["replan_p50_ms"] == numbers["replan_p99_ms"] == 1.0
    assert numbers["human_distance_min_m"] is None


def test_run_of_somebody_else_is_told_without_the_experts_plans():
    run = make_run(TRACK)
    numbers, others = run_numbers(run), run_numbers(dataclasses.replace(run, driver="policy"))
    assert set(numbers) - set(others) == {"replans", "paths", "replan_p50_ms", "replan_p99_ms"}
    assert others["outcome"] == numbers["outcome"]


def test_numbers_of_a_crooked_run_are_those_of_its_arrays():
    track = [(0.0, 5.6 - 0.01 * k) for k in range(50)]
    seen = {k: (0.0, 5.6) for k in [*range(3, 11), *range(40, 41)]}
    run = make_run(track, journal=make_journal([WAY[k:] for k in range(STEPS)], searches=(0, 40), seen=seen))
    rng = np.random.default_rng(2)
    trajectory = dataclasses.replace(
        run.trajectory, rate_hz=30, actions=rng.normal(0.3, 0.4, (STEPS, 2)), replanned=np.arange(STEPS) % 9 == 0,
        human_visible=np.arange(STEPS) % 3 == 0, human_distance_m=rng.uniform(1, 4, STEPS),
        time_to_collision_s=rng.uniform(2, 9, STEPS), replan_times_s=np.array([0.002, 0.004, 0.009]),
    )  # fmt: skip
    numbers = run_numbers(dataclasses.replace(run, trajectory=trajectory))
    gaps_m = [np.hypot(*(np.array(track[min(k, 49)]) - WAY[k])) for k in range(STEPS)]
    closest = int(np.argmin(gaps_m))
    (human,) = numbers["humans"]
    assert human["closest_m"] == pytest.approx(gaps_m[closest], abs=6e-4)
    assert human["closest_s"] == pytest.approx(closest / 30, abs=6e-3)
    assert human["visible_s"] == [[0.1, 0.37], [1.33, 1.37]]
    assert numbers["path_length_m"] == pytest.approx(np.abs(trajectory.actions[:, 0]).sum() / 30, abs=6e-4)
    assert numbers["duration_s"] == pytest.approx(STEPS / 30, abs=6e-3)
    assert (numbers["replans"], numbers["replan_p50_ms"]) == (9, 4.0)
    assert numbers["replan_p99_ms"] == pytest.approx(np.percentile([2.0, 4.0, 9.0], 99), abs=6e-4)
    assert numbers["human_distance_min_m"] == pytest.approx(trajectory.human_distance_m.min(), abs=6e-4)
    assert numbers["time_to_collision_min_s"] == pytest.approx(trajectory.time_to_collision_s.min(), abs=6e-4)
    assert numbers["human_visible_share"] == pytest.approx(27 / 80, abs=6e-4)
