import math

import pytest

from readygo.common.config import section_to_mapping
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


def test_obstacles_hide_humans_in_space_time_and_not_in_the_papers_mode():
    assert ExpertConfig().needs_line_of_sight
    assert not ExpertConfig(mode="paper").needs_line_of_sight


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(ExpertConfig()) == {
        "mode": "spacetime",
        "near_field_m": 0.0,
        "oracle": False,
        "range_m": 10.0,
    }


@pytest.mark.parametrize(("name", "wrong"), [("near_field_m", -1), ("range_m", 0), ("range_m", math.inf)])
def test_numbers_out_of_range_are_refused_by_name(name, wrong):
    with pytest.raises(ValueError, match=f"^{name} must be"):
        ExpertConfig(**{name: wrong})


def test_expert_looks_at_bodies_in_the_papers_mode_alone():
    assert ExpertConfig(mode="paper").needs_avatars
    assert not ExpertConfig().needs_avatars
