import math
from dataclasses import replace

import pytest

from readygo.benchmarks.planning.maps import MapSource
from readygo.benchmarks.planning.runs import Draw, PlanningJob, PlanningRun
from readygo.benchmarks.planning.summary import map_row, row_of, rows_of, text
from readygo.common.episode import EpisodeResult
from readygo.common.messages import Outcome

GOOD = PlanningRun(
    result=EpisodeResult(outcome=Outcome.SUCCESS, duration_s=10.0, path_length_m=5.0, shortest_m=4.0),
    failure="",
    closest_m=0.65,
    avatar_gap_m=0.3,
    turn_change_radps=4.0,
    free_m=3.0,
    free_s=4.0,
    replan_ms=(1.0, 3.0),
    expert_ms=30.0,
)
BAD = replace(
    GOOD,
    result=EpisodeResult(outcome=Outcome.HUMAN_COLLISION, duration_s=6.0, path_length_m=3.0, shortest_m=4.0),
    failure="human in view, robot moving",
    closest_m=0.45,
    free_m=0.0,
    free_s=0.0,
    replan_ms=(),
    expert_ms=10.0,
)
JOB = PlanningJob(source=MapSource(name="here", path="here.yaml"), modes=("paper",), tasks=("dynamic",), seed=1)
DRAWN = [
    Draw(index=0, rejected="no room", scenario_ms=4.0),
    Draw(index=1, scenario_ms=6.0, motion_ms=50.0, runs={("dynamic", "paper"): GOOD}),
    Draw(index=2, scenario_ms=10.0, motion_ms=70.0, runs={("dynamic", "paper"): BAD}),
]


def test_row_weighs_runs_by_time_and_counts_near_misses_without_collisions():
    row = row_of([GOOD, BAD], scenario_ms=5.0)
    assert (row["success_rate"], row["art_s"], row["near_misses"]) == (0.5, 30.0, 1)
    assert row["turn_change_radps2"] == 0.5
    assert row["free_speed_mps"] == 0.75
    assert row["failures"] == {"human in view, robot moving": 1}
    assert (row["expert_ms"], row["scenario_ms"], row["episodes_per_core_s"]) == (20.0, 5.0, 40.0)
    assert (row["replan_p50_ms"], row["replans_per_episode"]) == (2.0, 1.0)


def test_numbers_that_nothing_is_known_of_are_null():
    row = row_of([replace(BAD, avatar_gap_m=None, closest_m=math.inf)], scenario_ms=5.0)
    assert [row[key] for key in ("free_speed_mps", "replan_p50_ms", "avatar_gap_p5_m")] == [None, None, None]
    assert row["near_misses"] == 0


def test_rejected_draws_cost_time_but_no_episode():
    (row,) = rows_of(JOB, DRAWN)
    assert (row["map"], row["episode_count"]) == ("here", 2)
    assert row["scenario_ms"] == pytest.approx(10.0)
    place = map_row(JOB, DRAWN)
    assert (place["draws"], place["rejected"], place["motion_ms"]) == (3, {"no room": 1}, 60.0)


def test_text_has_rejections_a_line_per_mode_and_failures_in_80_columns_or_a_few_more():
    result = {"episodes": 2, "seed": 1, "people": "paper", "maps": [map_row(JOB, DRAWN)], "rows": rows_of(JOB, DRAWN)}
    lines = text(result).splitlines()
    assert "here: 3 draws, rejected: 1 no room" in lines
    (line,) = [line for line in lines if line.startswith("paper ")]
    assert line.split()[1:4] == ["50.0", "(9-91)", "30.0"]
    assert "  paper failed: 1 human in view, robot moving" in lines
    assert max(map(len, lines)) <= 120
