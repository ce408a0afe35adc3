import hashlib
import os

import pytest

from readygo.common.errors import ConfigError
from readygo.common.messages import HumanPlanRequest, Split
from readygo.services.planner import handle_human_plan
from readygo.services.planner.humans.scenario_file import (
    SPEED_MAX_MPS,
    STEP_MAX_MPS,
    load_scenarios,
    parse_scenarios,
    read_text,
    save_scenarios,
    text_hash,
)
from tests.services.planner.humans.scripts import ENTRY, HEAD, HUMAN, playing
from tests.services.planner.worlds import key


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


def test_a_file_that_is_not_there_or_no_text_is_refused(tmp_path):
    with pytest.raises(ConfigError, match="cannot be read"):
        load_scenarios(tmp_path / "none.toml")
    (tmp_path / "binary.toml").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(ConfigError, match="it is no text"):
        load_scenarios(tmp_path / "binary.toml")


@pytest.mark.parametrize("text", [b"a = " + b"[" * 100_000, b"a = " + b"9" * 5000, b"a = '\xff'"])
def test_file_beyond_a_limit_is_refused_in_one_line(tmp_path, text):
    (tmp_path / "s.toml").write_bytes(text)
    with pytest.raises(ConfigError, match=r"^Scenario file .*s\.toml (is no TOML|cannot be read): .*\.$"):
        load_scenarios(tmp_path / "s.toml")


def test_pipe_is_no_scenario_file(tmp_path):
    os.mkfifo(tmp_path / "s.toml")
    with pytest.raises(ConfigError, match="no regular file"):
        load_scenarios(tmp_path / "s.toml")


def test_ends_of_lines_do_not_change_what_a_run_is(tmp_path):
    (tmp_path / "a.toml").write_bytes(b"a = 1\nb = 2\n")
    (tmp_path / "b.toml").write_bytes(b"a = 1\r\nb = 2\r\n")
    assert read_text(tmp_path / "a.toml") == read_text(tmp_path / "b.toml")


WALK = "[[scenarios.humans]]\nwaypoints_m = [[2.0, 3.0], [-1.0, 6.0]]\n"


@pytest.mark.parametrize(
    ("allowed", "refused"),
    [
        (WALK + "speed_mps = 0.05\n", WALK + "speed_mps = 0.049\n"),
        (WALK + f"speed_mps = {SPEED_MAX_MPS}\n", WALK + f"speed_mps = {SPEED_MAX_MPS + 0.01}\n"),
        (WALK + "pauses_s = [999.0, 0.0]\n", WALK + "pauses_s = [1000.0, 0.0]\n"),
        (8 * WALK, 9 * WALK),
        ("yaw_rad = -99.0\n", "yaw_rad = nan\n"),
        (
            "[[scenarios.humans]]\ntrajectory_m = [[0.0, 4.0], [0.0, 4.0]]\nspeed_mps = 0.0\n",
            "[[scenarios.humans]]\ntrajectory_m = [[0.0, 4.0], [0.0, 4.0]]\nspeed_mps = -0.1\n",
        ),
        (
            f"[[scenarios.humans]]\ntrajectory_m = [[0.0, 4.0], [{0.0499 * STEP_MAX_MPS}, 4.0]]\n",
            f"[[scenarios.humans]]\ntrajectory_m = [[0.0, 4.0], [{0.0501 * STEP_MAX_MPS}, 4.0]]\n",
        ),
    ],
)
def test_limits_are_allowed_and_what_is_beyond_them_is_not(allowed, refused):
    assert len(parse_scenarios(HEAD + ENTRY + allowed, "people.toml").entries) == 1
    with pytest.raises(ConfigError, match=r"scenarios\[0\]"):
        parse_scenarios(HEAD + ENTRY + refused, "people.toml")


def test_entries_are_called_by_their_number_and_name_and_texts_by_their_hash():
    text = HEAD + ENTRY + 'name = "door"\n' + ENTRY
    entries = parse_scenarios(text, "people.toml")
    assert [entries.where(0), entries.where(1)] == ["people.toml, scenarios[0] 'door'", "people.toml, scenarios[1]"]
    assert text_hash(text) == hashlib.sha256(text.encode()).hexdigest()
    assert entries.entries[0].yaw_rad is None
