import numpy as np
import pytest

from readygo.common.avatars import SMPL_PARENTS
from readygo.common.avatars.importers.bone_names import (
    chain_between,
    joints_by_name,
    joints_of_humanoid,
    side_and_word,
)
from readygo.common.avatars.importers.joints import JOINT, JOINT_NAMES

PARENTS = SMPL_PARENTS.astype(np.int64)


@pytest.mark.parametrize(
    ("name", "side", "word"),
    [
        ("mixamorig:LeftForeArm", "left", "forearm"),
        ("J_Bip_R_UpperLeg", "right", "upperleg"),
        ("DEF-upper_arm.L", "left", "upperarm"),
        ("calf_r", "right", "calf"),
        ("Bip01 L Thigh", "left", "thigh"),
        ("rThighBend", "right", "thighbend"),
        ("spine_02", "", "spine"),
        ("lowerleg", "", "lowerleg"),
        ("Human", "", "human"),
    ],
)
def test_side_and_word_of_a_name(name: str, side: str, word: str) -> None:
    assert side_and_word(name) == (side, word)


def test_every_joint_but_the_spine_is_found_by_smpls_own_names() -> None:
    found = joints_by_name(JOINT_NAMES, PARENTS)
    assert found == {joint: JOINT[joint] for joint in JOINT_NAMES if not joint.startswith("spine")}


@pytest.mark.parametrize(
    ("names", "parts"),
    [
        (("LeftUpLeg", "LeftLeg", "LeftFoot", "LeftToeBase"), ("hip", "knee", "ankle", "")),
        (("leg_l", "knee_l", "foot_l", "toe_l"), ("hip", "knee", "ankle", "foot")),
        (("shoulder.L", "arm.L", "elbow.L", "hand.L"), ("collar", "shoulder", "elbow", "wrist")),
        (("clavicle_l", "shoulder_l", "forearm_l", "wrist_l"), ("collar", "shoulder", "elbow", "wrist")),
    ],
)
def test_plain_words_mean_what_their_neighbours_leave_to_them(names: tuple[str, ...], parts: tuple[str, ...]) -> None:
    found = joints_by_name(names, np.arange(-1, len(names) - 1))
    assert {joint: names[bone] for joint, bone in found.items() if joint != "left_foot" or "" not in parts} == {
        f"left_{part}": name for part, name in zip(parts, names, strict=True) if part
    }


def test_of_several_that_fit_the_one_nearest_to_the_root_is_taken() -> None:
    assert joints_by_name(("Hips", "Neck", "Neck1", "Head", "HeadTop"), np.arange(-1, 4)) == {
        "pelvis": 0,
        "neck": 1,
        "head": 3,
    }


def test_numbered_spine_runs_from_the_pelvis_to_the_head() -> None:
    names = ("spine", "spine.001", "spine.002", "spine.003", "spine.004", "spine.005", "shoulder.L", "upper_arm.L")
    parents = np.array([-1, 0, 1, 2, 3, 4, 3, 6])
    found = joints_by_name(names, parents)
    assert (found["pelvis"], found["neck"], found["head"]) == (0, 4, 5)


def test_pelvis_without_a_name_is_where_the_legs_meet() -> None:
    names = ("root", "trunk", "thigh_l", "thigh_r")
    assert joints_by_name(names, np.array([-1, 0, 1, 1]))["pelvis"] == 1


def test_humanoid_extensions_of_both_versions_name_bones() -> None:
    one = {"VRMC_vrm": {"humanoid": {"humanBones": {"hips": {"node": 7}, "leftHand": {"node": 9}}}}}
    zero = {"VRM": {"humanoid": {"humanBones": [{"bone": "hips", "node": 7}, {"bone": "jaw", "node": 8}]}}}
    assert joints_of_humanoid(one, (7, 8, 9)) == {"pelvis": 0, "left_wrist": 2}
    assert joints_of_humanoid(zero, (8, 7)) == {"pelvis": 1}
    assert joints_of_humanoid({}, (7,)) == {}


def test_chain_lies_strictly_between_an_ancestor_and_a_descendant() -> None:
    neck, pelvis = JOINT["neck"], JOINT["pelvis"]
    assert chain_between(pelvis, neck, PARENTS) == [JOINT["spine1"], JOINT["spine2"], JOINT["spine3"]]
    assert chain_between(JOINT["left_hip"], neck, PARENTS) == []


@pytest.mark.parametrize(
    "bones", [3, [7, {"bone": "hips"}, {"bone": ["a"], "node": 1}], {"hips": 4, "spine": {"node": [1]}}]
)
def test_humanoid_extensions_of_another_shape_name_nothing(bones: object) -> None:
    for key in ("VRM", "VRMC_vrm"):
        assert joints_of_humanoid({key: {"humanoid": {"humanBones": bones}}}, [1, 2]) == {}
