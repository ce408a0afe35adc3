import math

import numpy as np
import pytest

from readygo.common.errors import ConfigError
from readygo.common.messages import HumanPlanRequest, Split
from readygo.services.planner import HumanPlannerConfig, handle_human_plan
from readygo.services.planner.humans.scenario_file import load_scenarios, parse_scenarios, save_scenarios
from tests.services.planner.worlds import key, planner_of

HEAD = 'format = "readygo-scenarios/1"\n'
ENTRY = "[[scenarios]]\nstart_m = [-2.0, 4.0]\ngoal_m = [1.5, 5.0]\n"
HUMAN = "[[scenarios.humans]]\nwaypoints_m = [[2.0, 3.0], [-1.0, 6.0]]\n"


def playing(text, source="people.toml", **config):
    """A planner that plays the text of a scenario file in four rooms."""
    return planner_of(scenarios=parse_scenarios(text, source), **config)


def played(planner, index=0, **request):
    return handle_human_plan(planner, HumanPlanRequest(episode=key(index), **request)).scenario


def test_an_exported_file_gives_the_same_episodes_again_bit_by_bit(human_planner, tmp_path):
    drawn = [handle_human_plan(human_planner, HumanPlanRequest(episode=key(index))).scenario for index in range(8)]
    drawn = [scenario for scenario in drawn if scenario is not None]
    save_scenarios(tmp_path / "episodes.toml", drawn)
    again = playing((tmp_path / "episodes.toml").read_text(), reactive=True)
    for number, scenario in enumerate(drawn):
        copy = handle_human_plan(again, HumanPlanRequest(episode=key(number, split=Split.TRAIN, seed=77))).scenario
        assert copy.start_xyyaw.tobytes() == scenario.start_xyyaw.tobytes()
        assert copy.goal_xy_m.tobytes() == scenario.goal_xy_m.tobytes()
        for a, b in zip(copy.humans, scenario.humans, strict=True):
            assert (a.avatar, a.encounter, a.speed_mps) == (b.avatar, b.encounter, b.speed_mps)
            assert a.xy_m.tobytes() == b.xy_m.tobytes()


def test_a_file_is_written_whole_or_not_at_all(human_planner, tmp_path):
    with pytest.raises(ConfigError, match="no scenario"):
        save_scenarios(tmp_path / "none.toml", [])
    (tmp_path / "file").touch()
    with pytest.raises(ConfigError, match="cannot be written"):
        save_scenarios(tmp_path / "file" / "a.toml", [handle_human_plan(human_planner, _request()).scenario])
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


def _request():
    return HumanPlanRequest(episode=key(0))


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
    with pytest.raises(ConfigError, match=r"people.toml, scenarios\[0\]: goal_m .* within 0.2 m"):
        playing(inside, goal_snap_m=0.2)
    with pytest.raises(ConfigError, match=r"goal_snap_m = 0"):
        playing(inside, goal_snap_m=0.0)


@pytest.mark.parametrize(
    ("text", "complaint"),
    [
        ("", "must begin with format"),
        (HEAD, r"no \[\[scenarios\]\]"),
        (HEAD + "scenarios = [", "no TOML"),
        (HEAD + "[[scenarios]]\nstart_m = [0, 0]\n", r"people.toml, scenarios\[0\] lacks goal_m"),
        (HEAD + ENTRY + "speed = 3\n", r"Unknown key 'people.toml, scenarios\[0\].speed'"),
        (HEAD + ENTRY + HUMAN + "sped_mps = 3.0\n", r"Unknown key 'people.toml, scenarios\[0\].humans\[0\].sped_mps'"),
        (HEAD + ENTRY.replace("4.0", "nan"), r"scenarios\[0\]: start_m must be two finite numbers"),
        (HEAD + ENTRY.replace("-2.0, 4.0", "4.0"), r"start_m must be two finite numbers"),
        (HEAD + ENTRY.replace("4.0", "'here'"), r"start_m must be float"),
        (HEAD + ENTRY + "yaw_rad = inf\n", "yaw_rad must be finite"),
        (HEAD + ENTRY + ENTRY + HUMAN + "speed_mps = 0\n", r"scenarios\[1\].humans\[0\]: speed_mps must be 0.05"),
        (HEAD + ENTRY + HUMAN + "speed_mps = nan\n", "speed_mps must be"),
        (HEAD + ENTRY + HUMAN + "pauses_s = [1.0]\n", "one value per waypoint"),
        (HEAD + ENTRY + HUMAN + "pauses_s = [1.0, -1.0]\n", r"pauses_s must be 0\.\.1000"),
        (HEAD + ENTRY + HUMAN + "trajectory_m = [[0.0, 0.0]]\n", "either waypoints_m or trajectory_m"),
        (HEAD + ENTRY + "[[scenarios.humans]]\ntrajectory_m = [[0.0, 4.0], [1.0, 4.0]]\n", "jumps at 20.0 m/s"),
        (HEAD + ENTRY + 9 * HUMAN, "at most 8 humans"),
        (HEAD + ENTRY.replace("-2.0, 4.0", "0.5, 3.6"), r"scenarios\[0\]: start_m .* is in an obstacle"),
        (HEAD + ENTRY.replace("1.5, 5.0", "-2.0, 4.5"), "within 1 m of the start"),
        (HEAD + ENTRY.replace("1.5, 5.0", "40.0, 5.0"), "goal_m .* is in an obstacle"),
        (HEAD + ENTRY + HUMAN.replace("2.0, 3.0", "0.5, 3.6"), r"humans\[0\]: waypoints_m\[0\] \(0.5, 3.6\) is in an"),
        (HEAD + ENTRY + HUMAN.replace("2.0, 3.0", "-2.0, 4.1"), "collision at once"),
        (HEAD + ENTRY + HUMAN + 'avatar = "eve"\n', r"humans\[0\]: unknown avatar 'eve'; there are adam, mia, zoe"),
        (HEAD + ENTRY + HUMAN.replace("-1.0, 6.0", "2.0, 3.0"), r"waypoints_m\[1\] \(2, 3\) is where the one before"),
        (HEAD + 'name = "x"\n', "unknown key 'name'"),
    ],
)
def test_a_bad_file_is_one_line_that_names_file_and_entry(text, complaint):
    with pytest.raises(ConfigError, match=complaint) as error:
        playing(text)
    assert "people.toml" in str(error.value)
    assert "\n" not in str(error.value)


def test_names_of_entries_help_to_find_them():
    named = HEAD + ENTRY.replace("-2.0, 4.0", "0.5, 3.6") + 'name = "the table"\n'
    with pytest.raises(ConfigError, match=r"scenarios\[0\] 'the table': start_m"):
        playing(named)


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_scenarios(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="it is no text"):
        load_scenarios(tmp_path / "binary.toml")


def test_the_config_says_how_far_goals_move():
    with pytest.raises(ValueError, match="goal_snap_m"):
        HumanPlannerConfig(goal_snap_m=math.nan)
