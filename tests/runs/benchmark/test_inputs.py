import dataclasses
from pathlib import Path

import pytest

from readygo.common.errors import PolicyError
from readygo.common.policy import load_spec, save_spec
from readygo.runs.benchmark.inputs import DriverInputs, check_names, inputs_of, row_of
from readygo.runs.methods import BLIND
from readygo.runs.origin import DataOrigin, with_origin
from tests.common.policy.artifacts import write_policy
from tests.common.state_policy.state_policies import write_state_policy

SCENES = {"flat-0": "aa", "flat-1": "bb"}


def test_planners_know_the_map_and_say_which_people_they_are_told_of(tmp_path: Path):
    given = {driver: inputs_of(driver, tmp_path, SCENES) for driver in (*BLIND, "gnm", "mine.py:Mine")}
    assert given["straight-line"] == DriverInputs()
    assert given["expert-blind"] == DriverInputs(map=True)
    assert given["expert"].people == given["expert-paper"].people == "true, in view"
    assert "all" in given["social-force"].people
    assert given["gnm"].images == given["mine.py:Mine"].images == ("rgb",)
    assert given["gnm"].trained_on
    assert not any(inputs.images for driver, inputs in given.items() if driver in BLIND)


def test_policy_tells_its_images_and_which_scenes_of_the_suite_it_has_seen(tmp_path: Path):
    folder = write_policy(tmp_path / "mine" / "0")
    assert inputs_of("mine/0", tmp_path, SCENES).trained_on == "unknown"
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


def test_policies_in_one_folder_are_one_row():
    assert [row_of(name) for name in ("mine/0", "mine/1", "expert", "folder/file.py:Mine")] == [
        *("mine", "mine", "expert"),
        "folder/file.py:Mine",
    ]


def test_policy_without_a_name_is_refused():
    check_names(("expert", "mine"))
    with pytest.raises(PolicyError, match="put its folder into that of --checkpoints, and name it"):
        check_names(("expert", "policy"))
