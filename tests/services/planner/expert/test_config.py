import dataclasses
import math
import typing

import pytest

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.errors import ConfigError
from readygo.services.planner import ExpertConfig, expert_recipe


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("paper", ExpertConfig(mode="paper")),
        ("spacetime", ExpertConfig()),
        ("near_field", ExpertConfig(mode="spacetime", near_field_m=2.0)),
        ("oracle", ExpertConfig(mode="spacetime", oracle=True)),
    ],
)
def test_recipes_have_names(name, expected):
    assert expert_recipe(name) == expected


def test_unknown_recipe_is_refused_with_the_known_ones():
    with pytest.raises(ConfigError, match=r"'dwa'; known: paper, spacetime, near_field, oracle"):
        expert_recipe("dwa")


def test_obstacles_hide_humans_by_default_in_space_time_and_not_in_the_papers_mode():
    assert ExpertConfig().needs_line_of_sight
    assert not ExpertConfig(mode="paper").needs_line_of_sight
    assert ExpertConfig(mode="paper", line_of_sight=True).needs_line_of_sight
    assert not ExpertConfig(line_of_sight=False).needs_line_of_sight


def test_what_the_paper_states_is_the_default():
    config = ExpertConfig()
    assert config.prediction_s == 2.0
    assert (config.near_m, config.near_field_m, config.oracle) == (3.0, 0.0, False)


def test_who_leaves_the_view_is_remembered_for_four_seconds_and_who_stood_for_a_minute():
    # Recorded data and the tables of success rates rest on these.
    assert (ExpertConfig().memory_s, ExpertConfig().standing_memory_s) == (4.0, 60.0)
    assert (ExpertConfig().range_m, ExpertConfig().timed_prediction_s) == (10.0, 4.0)


KEYS = """
    buffer_m cell_margin_m chance_gain dear_factor doubt_growth_mps doubt_max_m doubt_mps evasion_gap_m
    expansions_max goal_tolerance_m hard_margin_m heading_count heuristic_weight keep_ratio line_of_sight
    lookahead_m memory_s mode near_field_m near_m nearness_cost oracle oracle_prediction_s prediction_s primitive_s
    range_m replan_distance_m replan_interval_min_s replan_lookahead_s replan_period_s route_weight slow_cost
    standing_margin_m standing_memory_s steering_cost swerve_cost tight_margin_m timed_expansions_max
    timed_heading_count timed_heuristic_weight timed_idle_replan_s timed_margin_m timed_prediction_s timed_replan_s
    timed_steering_cost tracking_margin_m turn_cost_m velocity_window_s wall_cost wall_distance_m yield_margin_m
    yield_to_humans
"""
"""Keys of [expert] in the runs recorded so far, all on one level."""
RANGES = {
    name: hint.__metadata__[0]
    for name, hint in typing.get_type_hints(ExpertConfig, include_extras=True).items()
    if hasattr(hint, "__metadata__")
}


def test_keys_of_recorded_runs_stay():
    recorded = section_to_mapping(ExpertConfig(mode="paper", memory_s=1.0))
    assert set(recorded) == {*KEYS.split(), "gear_cost_m", "reverse_cost"}
    recorded = {name: value for name, value in recorded.items() if name in KEYS.split()}
    assert section_from_mapping(ExpertConfig, recorded) == ExpertConfig(mode="paper", memory_s=1.0)


def test_every_number_has_a_range():
    numbers = {
        field.name
        for field in dataclasses.fields(ExpertConfig)
        if not isinstance(field.default, bool | str) and field.default is not None
    }
    assert set(RANGES) == numbers


@pytest.mark.parametrize("name", RANGES)
def test_numbers_out_of_range_are_refused_by_name(name):
    default = getattr(ExpertConfig(), name)
    for wrong in (-1, math.nan, math.inf):
        value = (wrong,) if isinstance(default, tuple) else wrong
        with pytest.raises(ValueError, match=f"^{name} must be"):
            ExpertConfig(**{name: value})


def test_predictions_longer_than_a_plan_can_be_are_refused():
    assert ExpertConfig(oracle_prediction_s=31.5).oracle_prediction_s == 31.5
    with pytest.raises(ValueError, match=r"primitive_s must be at least 0\.508 s for 32 s"):
        ExpertConfig(oracle_prediction_s=32.0)


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(ExpertConfig()) == {
        "lookahead_m": [1.0, 0.7, 0.45, 0.3, 0.2],
        "tracking_margin_m": 0.01,
        "yield_to_humans": True,
        "yield_margin_m": 0.15,
        "evasion_gap_m": 0.4,
        "timed_heuristic_weight": 1.2,
        "timed_heading_count": 36,
        "timed_expansions_max": 1000,
        "timed_steering_cost": 0.15,
        "swerve_cost": 0.1,
        "hard_margin_m": 0.03,
        "timed_margin_m": 0.4,
        "nearness_cost": 30.0,
        "timed_replan_s": 0.25,
        "timed_idle_replan_s": 1.0,
        "near_m": 3.0,
        "buffer_m": 0.25,
        "replan_period_s": 0.5,
        "keep_ratio": 1.25,
        "replan_distance_m": 1.5,
        "replan_lookahead_s": 2.0,
        "replan_interval_min_s": 0.1,
        "heading_count": 72,
        "heuristic_weight": 1.5,
        "steering_cost": 0.2,
        "slow_cost": 0.2,
        "turn_cost_m": 0.8,
        "expansions_max": 10000,
        "cell_margin_m": 0.01,
        "tight_margin_m": 0.03,
        "wall_cost": 0.5,
        "wall_distance_m": 0.2,
        "dear_factor": 40,
        "standing_margin_m": 0.5,
        "prediction_s": 2.0,
        "timed_prediction_s": 4.0,
        "oracle_prediction_s": 8.0,
        "route_weight": 2.0,
        "chance_gain": 2.0,
        "doubt_mps": 0.1,
        "doubt_growth_mps": 0.2,
        "doubt_max_m": 0.6,
        "near_field_m": 0.0,
        "oracle": False,
        "line_of_sight": None,
        "range_m": 10.0,
        "memory_s": 4.0,
        "standing_memory_s": 60.0,
        "velocity_window_s": 0.2,
        "mode": "spacetime",
        "primitive_s": 0.5,
        "reverse_cost": 1.0,
        "gear_cost_m": 0.3,
        "goal_tolerance_m": 0.25,
    }


def test_ranges_are_these():
    most = {"wall_cost": 10.0, "dear_factor": 60, "primitive_s": 5.0}
    least = {
        "velocity_window_s": 0.05, "wall_cost": 0.0, "dear_factor": 4, "primitive_s": 0.1, "heading_count": 8,
        "timed_heading_count": 8, "heuristic_weight": 1.0, "timed_heuristic_weight": 1.0, "keep_ratio": 1.0,
        "expansions_max": 1, "timed_expansions_max": 1,
    }  # fmt: skip
    positive = set(
        [
            "range_m",
            "prediction_s",
            "timed_prediction_s",
            "oracle_prediction_s",
            "near_m",
            "replan_period_s",
            "replan_distance_m",
            "replan_lookahead_s",
            "replan_interval_min_s",
            "timed_margin_m",
            "nearness_cost",
            "timed_replan_s",
            "timed_idle_replan_s",
            "lookahead_m",
            "evasion_gap_m",
            "goal_tolerance_m",
        ]
    )
    assert {name: limits.high for name, limits in RANGES.items() if limits.high < math.inf} == most
    assert {name: limits.above for name, limits in RANGES.items() if limits.above > -math.inf} == dict.fromkeys(
        positive, 0
    )
    rest = dict.fromkeys(set(RANGES) - positive, 0.0)
    assert {name: limits.low for name, limits in RANGES.items() if limits.low > -math.inf} == {**rest, **least}


def test_expert_looks_at_bodies_in_the_papers_mode_alone():
    assert ExpertConfig(mode="paper").needs_avatars
    assert not ExpertConfig().needs_avatars
