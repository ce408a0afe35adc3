from typing import Any

import pytest

from readygo.common.config import section_to_mapping
from readygo.common.episode import EpisodeConfig


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"human_count_min": 3}, r"human counts must be 0 <= min <= max <= 8, got 3\.\.2"),
        ({"human_count_max": 9}, "human counts"),
        ({"human_count_min": -1}, "human counts"),
        ({"human_speed_min_mps": 0.0}, "human speeds"),
        ({"human_speed_min_mps": 1.5}, "human speeds"),
        ({"human_speed_max_mps": 3.6}, "human speeds"),
        ({"success_radius_m": 3.0}, "goal distances"),
        ({"goal_distance_min_m": 10.5}, "goal distances"),
        ({"time_limit_s": 0.0}, "must be positive"),
        ({"human_radius_m": 0.0}, "must be positive"),
        ({"sharpness_min": -1.0}, "sharpness_min must be a number from 0 on"),
        ({"sharpness_min": float("nan")}, "sharpness_min must be"),
        ({"coverage_min": 1.1}, r"coverage_min 0\.\.1, got 0\.0 and 1\.1"),
    ],
)
def test_tasks_that_cannot_be_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        EpisodeConfig(**values)


def test_limits_themselves_are_allowed() -> None:
    EpisodeConfig(human_count_min=0, human_count_max=0)
    EpisodeConfig(human_count_min=8, human_count_max=8, human_speed_min_mps=3.5, human_speed_max_mps=3.5)
    EpisodeConfig(goal_distance_min_m=10.0)


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(EpisodeConfig()) == {
        "time_limit_s": 50.0,
        "success_radius_m": 1.0,
        "goal_distance_min_m": 3.0,
        "goal_distance_max_m": 10.0,
        "human_count_min": 1,
        "human_count_max": 2,
        "human_speed_min_mps": 0.8,
        "human_speed_max_mps": 1.4,
        "human_radius_m": 0.25,
        "sharpness_min": 0.0,
        "coverage_min": 0.0,
    }
