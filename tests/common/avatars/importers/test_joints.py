import numpy as np
import pytest

from readygo.common.avatars.importers.joints import JOINT, minimal_rotation, rotations_to_tpose, tpose_joints
from tests.common.avatars.importers.humans import lowered_arms, tpose_joints_m


def bone(joints: np.ndarray, start: str, end: str) -> np.ndarray:
    step = joints[JOINT[end]] - joints[JOINT[start]]
    return step / np.linalg.norm(step)


def test_lowered_arms_turn_up_into_the_tpose_on_both_sides() -> None:
    joints = lowered_arms(tpose_joints_m(), 0.8)
    placed = tpose_joints(joints, rotations_to_tpose(joints))
    for side, sign in (("left", 1.0), ("right", -1.0)):
        assert bone(joints, f"{side}_shoulder", f"{side}_elbow")[1] < -0.6
        for start, end in (("shoulder", "elbow"), ("elbow", "wrist"), ("wrist", "hand")):
            assert sign * bone(placed, f"{side}_{start}", f"{side}_{end}")[0] > 0.99


def test_trunk_head_and_feet_stay_and_hands_follow_wrists() -> None:
    joints = lowered_arms(tpose_joints_m(), 0.5)
    R = rotations_to_tpose(joints)
    stay = [JOINT[name] for name in ("pelvis", "spine3", "neck", "head", "left_ankle", "right_foot", "left_collar")]
    np.testing.assert_array_equal(R[stay], np.tile(np.eye(3), (len(stay), 1, 1)))
    np.testing.assert_array_equal(R[JOINT["left_hand"]], R[JOINT["left_wrist"]])
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (24, 1, 1)), atol=1e-12)


def test_smallest_rotation_turns_one_direction_into_the_other_and_nothing_across() -> None:
    R = minimal_rotation(np.array([2.0, 0.0, 0.0]), np.array([0.0, 3.0, 0.0]))
    np.testing.assert_allclose(R @ (1, 0, 0), (0, 1, 0), atol=1e-12)
    np.testing.assert_allclose(R @ (0, 0, 1), (0, 0, 1), atol=1e-12)


@pytest.mark.parametrize("second", [(-1.0, 0.0, 0.0), (0.0, 0.0, 0.0)])
def test_opposite_and_zero_directions_turn_nothing(second: tuple[float, ...]) -> None:
    np.testing.assert_array_equal(minimal_rotation(np.array([1.0, 0.0, 0.0]), np.array(second)), np.eye(3))


def test_turned_bones_keep_their_length_and_carry_what_hangs_on_them() -> None:
    joints = tpose_joints_m()
    R = np.tile(np.eye(3), (24, 1, 1))
    R[JOINT["left_knee"]] = np.diag([1.0, -1.0, -1.0])
    placed = tpose_joints(joints, R)
    shin = joints[JOINT["left_ankle"]] - joints[JOINT["left_knee"]]
    np.testing.assert_allclose(placed[JOINT["left_ankle"]], joints[JOINT["left_knee"]] + shin * (1, -1, -1))
    np.testing.assert_allclose(
        placed[JOINT["left_foot"]] - placed[JOINT["left_ankle"]],
        joints[JOINT["left_foot"]] - joints[JOINT["left_ankle"]],
    )
    np.testing.assert_allclose(placed[JOINT["head"]], joints[JOINT["head"]])
