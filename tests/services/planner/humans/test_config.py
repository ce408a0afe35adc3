import math

import pytest

from readygo.common.config import section_to_mapping
from readygo.services.planner import FamilyMix, HumanPlannerConfig


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
        "reactive_cone_deg": 200.0,
        "reactive_range_m": 5.0,
        "goal_snap_m": 0.5,
        "slope_max": 0.0,
        "start_margin_m": 0.1,
        "detour_max": 3.0,
        "clearance_m": 0.35,
        "route_clearance_m": 0.375,
        "preferred_clearance_m": 0.6,
        "spline_spacing_m": 0.4,
        "obstacle_weight": 200.0,
        "jerk_weight": 2.0,
        "length_weight": 0.02,
        "iterations": 60,
        "crossing_fraction_min": 0.3,
        "crossing_fraction_max": 0.7,
        "crossing_angle_min_deg": 45.0,
        "crossing_angle_max_deg": 135.0,
        "parallel_offset_m": 1.0,
        "robot_speed_fraction": 0.85,
        "meeting_jitter_s": 0.5,
        "start_distance_min_m": 1.5,
        "start_peace_s": 3.0,
        "start_peace_m": 0.75,
        "parked_distance_min_m": 1.6,
        "attempts": 150,
        "searches": 1000,
        "families_tried": 4,
        "fewer_humans": False,
        "hidden_until_s": 2.0,
        "pause_min_s": 1.5,
        "pause_max_s": 4.0,
    }


@pytest.mark.parametrize(
    ("allowed", "refused", "words"),
    [
        ({"clearance_m": 0.375}, {"clearance_m": 0.376}, "clearances"),
        ({"route_clearance_m": 0.6}, {"route_clearance_m": 0.61}, "clearances"),
        ({"clearance_m": 1e-6}, {"clearance_m": 0.0}, "clearances"),
        ({"absent": 0.0}, {"absent": -0.01}, "absent must be"),
        ({"absent": 1.0}, {"absent": 1.01}, "absent must be"),
        ({"absent_first": 0}, {"absent_first": -1}, "absent_first"),
        ({"goal_snap_m": 5.0}, {"goal_snap_m": 5.01}, "goal_snap_m"),
        ({"goal_snap_m": 0.0}, {"goal_snap_m": -0.1}, "goal_snap_m"),
        ({"slope_max": 0.0}, {"slope_max": -0.1}, "slope_max"),
        ({"reactive_cone_deg": 360.0}, {"reactive_cone_deg": 361.0}, "reactive_cone_deg"),
        ({"reactive_cone_deg": 1.0}, {"reactive_cone_deg": 0.0}, "reactive_cone_deg"),
        ({"reactive_range_m": 0.1}, {"reactive_range_m": 0.0}, "reactive_range_m"),
        ({"hidden_until_s": 10.0}, {"hidden_until_s": 10.1}, "hidden_until_s"),
        ({"hidden_until_s": 0.1}, {"hidden_until_s": 0.0}, "hidden_until_s"),
        ({"pause_min_s": 4.0}, {"pause_min_s": 4.1}, "pauses"),
        ({"pause_min_s": 0.1}, {"pause_min_s": 0.0}, "pauses"),
        ({"crossing_fraction_min": 0.7}, {"crossing_fraction_min": 0.71}, "crossing fractions"),
        ({"crossing_fraction_min": 0.0}, {"crossing_fraction_min": -0.1}, "crossing fractions"),
        ({"crossing_fraction_max": 1.0}, {"crossing_fraction_max": 1.1}, "crossing fractions"),
        ({"detour_max": 1.0}, {"detour_max": 0.99}, "detour_max"),
        ({"attempts": 1}, {"attempts": 0}, "attempts"),
        ({"searches": 1}, {"searches": 0}, "searches"),
        ({"families_tried": 1}, {"families_tried": 0}, "families_tried"),
    ],
)
def test_limits_are_allowed_and_what_is_beyond_them_is_not(allowed, refused, words):
    HumanPlannerConfig(**allowed)
    with pytest.raises(ValueError, match=words):
        HumanPlannerConfig(**refused)
