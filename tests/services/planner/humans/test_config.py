import math

import pytest

from readygo.common.config import section_to_mapping
from readygo.services.planner import HumanPlannerConfig
from readygo.services.planner.humans.config import FamilyMix


@pytest.mark.parametrize("shares", [{"crossing": -1.0}, {"frontal": math.nan}, {}])
def test_mixes_that_cannot_be_drawn_are_refused(shares):
    with pytest.raises(ValueError, match=r"must be a number|share above 0"):
        FamilyMix(**shares)


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(HumanPlannerConfig()) == {
        "mix": {
            "crossing": 0.5,
            "parallel": 0.5,
            "frontal": 0.0,
            "overtaking": 0.0,
            "crossing_left": 0.0,
            "crossing_right": 0.0,
            "blind_corner": 0.0,
            "doorway": 0.0,
            "standing_group": 0.0,
            "stop_and_go": 0.0,
            "goalward": 0.0,
        },
        "absent": 0.0,
        "absent_first": 0,
        "reactive": False,
        "yielding": 1.0,
        "standing_min": 0,
        "standing_max": 0,
        "slope_max": 0.0,
        "fewer_humans": False,
        "spacing": "wide",
        "effort": "thorough",
    }


@pytest.mark.parametrize(
    ("allowed", "refused", "words"),
    [
        ({"absent": 0.0}, {"absent": -0.01}, "absent must be"),
        ({"absent": 1.0}, {"absent": 1.01}, "absent must be"),
        ({"absent_first": 0}, {"absent_first": -1}, "absent_first"),
        ({"yielding": 0.0}, {"yielding": -0.1}, "yielding must be"),
        ({"standing_max": 4}, {"standing_max": 5}, "standing humans must be"),
        ({"standing_min": 1, "standing_max": 1}, {"standing_min": 1}, "standing humans must be"),
        ({"slope_max": 0.0}, {"slope_max": -0.1}, "slope_max"),
        ({"spacing": "narrow"}, {"spacing": "close"}, "spacing must be one of wide, narrow"),
        ({"effort": "quick"}, {"effort": "fast"}, "effort must be one of thorough, quick"),
    ],
)
def test_limits_are_allowed_and_what_is_beyond_them_is_not(allowed, refused, words):
    HumanPlannerConfig(**allowed)
    with pytest.raises(ValueError, match=words):
        HumanPlannerConfig(**refused)
