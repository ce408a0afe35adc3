import math

import numpy as np
import pytest

from readygo.common.errors import ConfigError
from tests.services.planner.humans.scripts import ENTRY, HEAD, HUMAN, played, playing


def test_waypoints_are_walked_at_the_speed_with_the_pauses():
    walk = "[[scenarios.humans]]\nwaypoints_m = [[2.0, 3.0], [-1.5, 2.8], [-1.0, 6.0]]\n"
    text = HEAD + ENTRY + walk + 'pauses_s = [1.0, 2.5, 0.0]\nspeed_mps = 0.9\navatar = "mia"\nencounter = "visitor"\n'
    (human,) = played(playing(text)).humans
    assert (human.avatar, human.encounter, human.speed_mps) == ("mia", "visitor", 0.9)
    assert human.xy_m[0] == pytest.approx((2.0, 3.0))
    assert human.xy_m[-1] == pytest.approx((-1.0, 6.0))
    speed = np.hypot(*np.diff(human.xy_m, axis=0).T) / 0.05
    assert speed.max() == pytest.approx(0.9, abs=0.01)
    assert np.flatnonzero(speed > 0)[0] == 20
    still = np.flatnonzero(speed[30:] < 1e-9) + 30
    assert len(still) == pytest.approx(50, abs=1)
    assert np.hypot(*(human.xy_m[still[0]] - (-1.5, 2.8))) < 0.01


def test_a_way_back_pauses_where_it_turns():
    walk = "[[scenarios.humans]]\nwaypoints_m = [[2.0, 3.0], [-2.0, 3.0], [2.0, 3.2]]\npauses_s = [0.0, 2.0, 0.0]\n"
    (human,) = played(playing(HEAD + ENTRY + walk)).humans
    speed = np.hypot(*np.diff(human.xy_m, axis=0).T)
    still = np.flatnonzero(speed < 1e-9)
    assert human.xy_m[still[0]] == pytest.approx((-2.0, 3.0))


def test_a_single_waypoint_is_somebody_who_stands():
    (human,) = played(playing(HEAD + ENTRY + "[[scenarios.humans]]\nwaypoints_m = [[2.0, 3.0]]\n")).humans
    assert human.xy_m.tolist() == [[2.0, 3.0]]


def test_entries_are_played_in_turn_and_the_run_chooses_who_is_not_named():
    planner = playing(HEAD + ENTRY + HUMAN + ENTRY.replace("1.5", "1.0"))
    goals = [played(planner, index).goal_xy_m[0] for index in range(4)]
    assert goals == [1.5, 1.0, 1.5, 1.0]
    assert len({played(planner, 2 * k).humans[0].avatar for k in range(20)}) == 3
    assert played(planner).start_xyyaw[2] == math.atan2(1.0, 3.5)
    assert played(planner, static=True).humans == ()


def test_a_goal_in_an_obstacle_moves_to_the_nearest_free_place_if_it_may():
    inside = HEAD + "[[scenarios]]\nstart_m = [-2.0, 3.0]\ngoal_m = [0.35, 3.4]\n"
    goal = played(playing(inside)).goal_xy_m
    assert 0 < np.hypot(*(goal - (0.35, 3.4))) <= 0.5
    with pytest.raises(ConfigError, match=r"people.toml, scenarios\[0\]: goal_m .* within 0.5 m"):
        playing(inside.replace("0.35, 3.4", "0.5, 3.9"))


def test_names_of_entries_help_to_find_them():
    named = HEAD + ENTRY.replace("-2.0, 4.0", "0.5, 3.6") + 'name = "the table"\n'
    with pytest.raises(ConfigError, match=r"scenarios\[0\] 'the table': start_m"):
        playing(named)


def test_scripted_scenario_is_as_it_was(golden_figures):
    walk = (
        "[[scenarios.humans]]\nwaypoints_m = [[2.2, 3.1], [-1.3, 2.9], [-1.1, 6.3], [2.3, 5.8]]\n"
        "pauses_s = [0.6, 1.7, 0.0, 2.1]\nspeed_mps = 1.13\n"
    )
    played_ = played(playing(HEAD + ENTRY + walk))
    golden_figures("humans/scripted", played_.humans[0].xy_m)
    golden_figures("humans/scripted task", [[*played_.start_xyyaw, *played_.goal_xy_m, played_.humans[0].speed_mps]])
