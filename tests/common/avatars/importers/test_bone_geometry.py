import numpy as np
import pytest

from readygo.common.avatars import SMPL_PARENTS
from readygo.common.avatars.importers.bone_geometry import joints_by_place
from readygo.common.avatars.importers.joints import JOINT
from tests.common.avatars.importers.humans import HEIGHT_M, lowered_arms, tpose_joints_m

PARENTS = SMPL_PARENTS.astype(np.int64)
LIMBS = ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist")


@pytest.mark.parametrize("unit", [1.0, 100.0])
@pytest.mark.parametrize("lowered_rad", [0.0, 0.7])
def test_limbs_are_found_on_their_sides_in_any_unit(unit: float, lowered_rad: float) -> None:
    heads = unit * lowered_arms(tpose_joints_m(), lowered_rad)
    # A finger more at each hand: without a fork the last bone is taken for the wrist.
    fingers = heads[[JOINT["left_hand"], JOINT["right_hand"]]] + unit * np.array([0.0, 0.0, 0.03])
    parents = np.concatenate([PARENTS, [JOINT["left_wrist"], JOINT["right_wrist"]]])
    found = joints_by_place(np.concatenate([heads, fingers]), parents, unit * HEIGHT_M)
    for joint in ("pelvis", *(f"{side}_{part}" for side in ("left", "right") for part in LIMBS)):
        assert found[joint] == JOINT[joint], joint


def test_head_is_the_highest_bone_below_the_crown() -> None:
    heads = np.concatenate([tpose_joints_m(), [[0.0, HEIGHT_M, 0.02]]])
    found = joints_by_place(heads, np.concatenate([PARENTS, [JOINT["head"]]]), HEIGHT_M)
    assert (found["head"], found["neck"]) == (JOINT["head"], JOINT["neck"])


def with_bone_above(joint: str, place: tuple[float, float, float]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Heads and parents with one bone more between a joint and its parent; where each joint is then."""
    number = JOINT[joint]
    moved = np.where(np.arange(24) < number, np.arange(24), np.arange(24) + 1)
    parents = np.insert(np.where(PARENTS < 0, -1, moved[PARENTS]), number, moved[PARENTS[number]])
    parents[number + 1] = number
    return np.insert(tpose_joints_m(), number, place, axis=0), parents, moved


def test_hip_bone_that_only_leads_to_the_side_is_not_the_thigh() -> None:
    heads, parents, moved = with_bone_above("left_hip", (0.01, 0.95, 0.0))
    assert joints_by_place(heads, parents, HEIGHT_M)["left_hip"] == moved[JOINT["left_hip"]]


@pytest.mark.parametrize(
    ("joint", "place"),
    [("left_knee", (0.095, 0.85, 0.0)), ("left_ankle", (0.1, 0.2, -0.01)), ("left_elbow", (0.25, 1.43, 0))],
)
def test_bones_that_only_twist_are_neither_knee_nor_elbow(joint: str, place: tuple[float, float, float]) -> None:
    heads, parents, moved = with_bone_above(joint, place)
    found = joints_by_place(heads, parents, HEIGHT_M)
    for name in ("left_hip", "left_knee", "left_ankle", "left_shoulder", "left_elbow"):
        assert found[name] == moved[JOINT[name]], name


def test_a_chain_of_bones_is_no_body() -> None:
    heads = np.stack([np.zeros(6), np.linspace(0.0, 1.7, 6), np.zeros(6)], axis=1)
    assert joints_by_place(heads, np.arange(-1, 5), 1.7) == {}
