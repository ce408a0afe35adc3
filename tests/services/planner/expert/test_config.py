import pytest

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
