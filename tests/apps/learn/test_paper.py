import json
from pathlib import Path
from typing import Any

import pytest

from readygo.apps.learn.paper import LEAST_SHARE, data_of, first_plan, minutes_after, policy_keys, teacher_of
from readygo.apps.learn.perceive_plan import FORMAT, STATE_FILE, PerceivePlan
from readygo.common.errors import ConfigError, RunError
from readygo.runs.scene_argument import open_scene
from tests.common.state_policy.state_policies import write_state_policy


def plan_in(out: Path, **more: Any) -> PerceivePlan:
    given: dict[str, Any] = {"config": None, "robot": None, "keys": {}, "minutes": 8.0, "avatars": None, "seed": 0}
    return first_plan(("embedded",), out, **(given | more))


def write_first(out: Path, minutes: float) -> None:
    (out / "perceive").mkdir(parents=True)
    state = {"format": FORMAT, "scenes": [open_scene("embedded").content_hash], "minutes": minutes}
    (out / "perceive" / STATE_FILE).write_text(json.dumps(state))


def test_first_part_has_two_fifths_of_the_time_and_the_camera_of_policies(tmp_path: Path) -> None:
    plan = plan_in(tmp_path / "run")
    assert (plan.out, plan.minutes) == (tmp_path / "run" / "perceive", pytest.approx(3.2))
    assert (plan.config.robot.camera.height_px, plan.config.robot.camera.width_px) == (72, 128)
    assert plan.people == tmp_path / "run" / "perceive" / "people"
    assert not (tmp_path / "run").exists()
    robot = tmp_path / "robot.toml"
    robot.write_text("radius_m = 0.2\n[camera]\nheight_px = 144\nwidth_px = 256\n")
    own = plan_in(tmp_path / "run", robot=robot).config.robot
    assert (own.radius_m, own.camera.height_px) == (0.2, 144)


@pytest.mark.parametrize(
    ("learn", "words"), [({"goal": "both"}, 'goal "point"'), ({"images": ["rgb", "depth"]}, "rgb of one camera")]
)
def test_policy_that_sees_more_is_refused_before_anything_is_recorded(
    learn: dict[str, Any], words: str, tmp_path: Path
) -> None:
    with pytest.raises(ConfigError, match=words):
        plan_in(tmp_path / "run", keys={"learn": learn})
    assert not (tmp_path / "run").exists()


def test_folder_of_something_else_is_refused_unless_the_second_part_has_begun_there(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine")
    with pytest.raises(RunError, match="holds files of something else"):
        plan_in(tmp_path)
    write_first(tmp_path, 1.0)
    with pytest.raises(RunError, match="holds files of something else"):
        plan_in(tmp_path)
    (tmp_path / "learn.json").write_text("{}")
    assert plan_in(tmp_path).out == tmp_path / "perceive"


def test_second_part_has_the_time_that_is_left(tmp_path: Path) -> None:
    write_first(tmp_path, 3.5)
    plan = plan_in(tmp_path)
    # The third part takes three tenths.
    assert minutes_after(plan, 8.0) == pytest.approx(0.7 * 8.0 - 3.5)
    assert minutes_after(plan, 6.0) == 6.0 * LEAST_SHARE


def test_data_of_the_first_part_are_in_order(tmp_path: Path) -> None:
    plan = plan_in(tmp_path / "run")
    for name in ("b", "a-crowd", "a"):
        (plan.out / "data" / name).mkdir(parents=True)
    assert [folder.name for folder in data_of(plan)] == ["a", "a-crowd", "b"]


def test_expert_teaches_where_no_policy_on_states_was_left(tmp_path: Path) -> None:
    plan = plan_in(tmp_path)
    assert teacher_of(plan) is None
    write_state_policy(plan.out / "rl")
    assert teacher_of(plan) == plan.out / "rl"


def test_expert_teaches_where_the_settings_say_so(tmp_path: Path) -> None:
    assert plan_in(tmp_path / "run").policy_on_states
    (tmp_path / "run.toml").write_text('[learn]\nteacher = "expert"\n')
    keys = [{"learn": {"teacher": name}} for name in ("expert", "expert-tracked")]
    for more in ({"config": tmp_path / "run.toml"}, *({"keys": each} for each in keys)):
        plan = plan_in(tmp_path / "run", **more)
        assert not plan.policy_on_states
    write_state_policy(plan.out / "rl")
    assert teacher_of(plan) is None


def test_policy_of_the_paper_has_no_memory_unless_one_is_given(tmp_path: Path) -> None:
    config, robot = tmp_path / "run.toml", {"radius_m": 0.3}
    assert policy_keys({"robot": robot}, None) == {"robot": robot, "learn": {"memory": 0}}
    assert policy_keys({"learn": {"reuse": 2.0}}, None) == {"learn": {"reuse": 2.0, "memory": 0}}
    assert policy_keys({"learn": {"memory": 64}}, None) == {"learn": {"memory": 64}}
    config.write_text("[learn]\nreuse = 2\n")
    assert policy_keys({}, config) == {"learn": {"memory": 0}}
    config.write_text("[learn]\nmemory = 32\n")
    assert policy_keys({}, config) == {}
