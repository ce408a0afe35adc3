import dataclasses
from pathlib import Path

import pytest

from readygo.common.config import section_to_mapping
from readygo.common.errors import PolicyError
from readygo.common.perception.artifact import PerceptionSpec, save_perception_spec
from readygo.common.policy import load_spec, save_spec
from readygo.common.robot import RobotConfig
from readygo.common.state_policy.state_policy import load_state_policy
from readygo.runs.benchmark.inputs import DriverInputs, check_names, inputs_of, row_of, unstated
from readygo.runs.methods import BLIND
from readygo.runs.origin import DataOrigin, with_origin
from tests.common.policy.artifacts import write_policy
from tests.common.state_policy.state_policies import write_state_policy

SCENES = {"flat-0": "aa", "flat-1": "bb"}


def test_planners_know_the_map_and_say_which_people_they_are_told_of(tmp_path: Path):
    given = {driver: inputs_of(driver, tmp_path, SCENES) for driver in (*BLIND, "gnm", "gnm/zero-shot")}
    assert given["straight-line"] == DriverInputs()
    assert given["expert-blind"] == DriverInputs(map=True)
    assert given["expert"].people == given["expert-paper"].people == "true, in view"
    assert "all" in given["social-force"].people
    assert given["gnm"] == given["gnm/zero-shot"]
    assert given["gnm"].images == ("rgb",)
    assert given["gnm"].learns
    assert given["gnm"].seen is None, "its weights do not say"
    assert not any(inputs.images for driver, inputs in given.items() if driver in BLIND)


def test_policy_tells_its_images_and_which_scenes_of_the_suite_it_has_seen(tmp_path: Path):
    folder = write_policy(tmp_path / "mine" / "0")
    unknown = inputs_of("mine/0", tmp_path, SCENES)
    assert (unknown.trained_on, unknown.seen) == ("unknown", None)
    origin = DataOrigin(scenes={"bb": "lobby", "cc": "hall"}, avatars={"amara": "a", "dae": "d"})
    save_spec(with_origin(load_spec(folder), origin), folder)
    inputs = inputs_of("mine/0", tmp_path, SCENES)
    assert inputs == DriverInputs(images=("rgb",), trained_on="lobby, hall; 2 people", seen=("flat-1",))
    alone = dataclasses.replace(origin, avatars={})
    save_spec(with_origin(load_spec(folder), alone), folder)
    assert inputs_of("mine/0", tmp_path, SCENES).trained_on == "lobby, hall; no people"


def test_state_policy_knows_a_map_and_detected_people(tmp_path: Path):
    write_state_policy(tmp_path / "rl")
    inputs = inputs_of("rl", tmp_path, SCENES)
    assert (inputs.map, inputs.images, inputs.people) == (True, (), "detected, in view")
    assert inputs.trained_on


@pytest.mark.parametrize(
    ("attribute", "trained_on", "seen"),
    [("", None, None), ("trained_on = ''", "", ()), ("trained_on = 'ten films'", "ten films", None)],
)
def test_class_states_what_it_has_learned_from(tmp_path: Path, attribute: str, trained_on: str | None, seen):
    (tmp_path / "mine.py").write_text(f"class Mine:\n    {attribute or 'pass'}\n")
    inputs = inputs_of(f"{tmp_path / 'mine.py'}:Mine", tmp_path, SCENES)
    assert inputs == DriverInputs(images=("rgb",), trained_on=trained_on, seen=seen)


def write_perception(folder: Path, training: dict[str, object]) -> None:
    folder.mkdir(exist_ok=True)
    save_perception_spec(PerceptionSpec(robot=RobotConfig(), training=training), folder)


def test_drivers_that_perceive_state_what_perception_and_policy_learned_from(tmp_path: Path):
    origin = DataOrigin(scenes={"bb": "lobby"}, avatars={"amara": "a"})
    write_perception(tmp_path / "perception", {"data": section_to_mapping(origin)})
    write_state_policy(tmp_path / "rl")
    (learned_in,) = load_state_policy(tmp_path / "rl").spec.scenes.items()
    scenes = {**SCENES, "flat-2": learned_in[0]}
    planning, acting = (inputs_of(driver, tmp_path, scenes) for driver in ("perceive-and-plan", "perceive-and-act"))
    assert planning == DriverInputs(
        map=True, images=("rgb",), trained_on="lobby; 1 people (perception)", seen=("flat-1",)
    )
    assert acting.trained_on == f"lobby; 1 people (perception); {learned_in[1]} (policy)"
    assert acting.seen == ("flat-1", "flat-2")
    write_perception(tmp_path / "perception", {})
    acting = inputs_of("perceive-and-act", tmp_path, scenes)
    assert (acting.trained_on, acting.seen) == (f"unknown (perception); {learned_in[1]} (policy)", None)


def test_missing_or_damaged_origin_of_perception_names_its_driver(tmp_path: Path):
    with pytest.raises(PolicyError, match=r"The driver perceive-and-plan: .*perception"):
        inputs_of("perceive-and-plan", tmp_path, SCENES)
    write_perception(tmp_path / "perception", {"data": "films"})
    with pytest.raises(PolicyError, match=r"The driver perceive-and-plan: \[training\.data\] of the network's"):
        inputs_of("perceive-and-plan", tmp_path, SCENES)


def test_first_format_states_no_training_of_classes_networks_and_drivers_that_perceive():
    inputs = DriverInputs(map=True, trained_on="films", seen=("flat-0",))
    for driver in ("mine.py:Mine", "gnm", "vint/fine-tuned", "perceive-and-act"):
        assert unstated(driver, inputs) == DriverInputs(map=True, trained_on=None, seen=None)
    assert unstated("mine/0", inputs) == inputs
    assert unstated("mine/0", DriverInputs(trained_on="unknown")).seen is None


def test_policies_in_one_folder_are_one_row_and_kinds_of_a_network_are_several():
    rows = {
        "mine/0": "mine",
        "mine/1": "mine",
        "expert": "expert",
        "folder/file.py:Mine": "folder/file.py:Mine",
        "gnm": "gnm",
        "gnm/zero-shot": "gnm/zero-shot",
        "gnm/fine-tuned/0": "gnm/fine-tuned",
    }
    assert {name: row_of(name) for name in rows} == rows


def test_policy_without_a_name_is_refused():
    check_names(("expert", "mine"))
    with pytest.raises(PolicyError, match="put its folder into that of --checkpoints, and name it"):
        check_names(("expert", "policy"))
