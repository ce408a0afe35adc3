import numpy as np
import pytest

from readygo.common.avatars import SMPL_PARENTS
from readygo.common.avatars.importers.gltf_scene import Bones
from readygo.common.avatars.importers.joints import JOINT, JOINT_NAMES
from readygo.common.avatars.importers.skeleton import (
    Mapping24,
    axes_to_smpl,
    joint_of_bones,
    recognise_joints,
    skeleton_report,
    smpl_joints,
)
from readygo.common.errors import AvatarError
from readygo.common.frames import matrix_from_axis_angle
from tests.common.avatars.importers.humans import HEIGHT_M, tpose_joints_m

TOES = {"left": np.array([0.10, 0.02, 0.17]), "right": np.array([-0.10, 0.02, 0.17])}
EVERY = Mapping24(bone=dict(JOINT), source="names")


def skeleton(*extra: tuple[str, str], drop: tuple[str, ...] = ()) -> Bones:
    """SMPL's own skeleton with more bones, given by name and the joint that they hang at, and without some."""
    kept = [name for name in JOINT_NAMES if name not in drop]
    names = [*kept, *(name for name, _ in extra)]
    above = []
    for name in kept:
        parent = int(SMPL_PARENTS[JOINT[name]])
        while parent >= 0 and JOINT_NAMES[parent] in drop:
            parent = int(SMPL_PARENTS[parent])
        above.append(kept.index(JOINT_NAMES[parent]) if parent >= 0 else -1)
    above += [names.index(joint) for _, joint in extra]
    heads = [tpose_joints_m()[JOINT[name]] for name in kept]
    for _, parent_name in extra:
        heads.append(heads[names.index(parent_name)] + (0.0, 0.0, 0.02))
    return Bones(names=tuple(names), nodes=tuple(range(len(names))), parents=np.array(above), heads=np.array(heads))


def found(bones: Bones) -> Mapping24:
    return recognise_joints(bones, {}, bones.heads, HEIGHT_M)


def test_names_decide_before_geometry_and_the_extension_before_names() -> None:
    bones = skeleton()
    assert (found(bones).source, found(bones).bone) == ("names", JOINT)
    swapped = {"VRMC_vrm": {"humanoid": {"humanBones": {"head": {"node": JOINT["neck"]}}}}}
    mapping = recognise_joints(bones, swapped, bones.heads, HEIGHT_M)
    assert (mapping.source, mapping.bone["head"]) == ("humanoid extension", JOINT["neck"])


@pytest.mark.parametrize(
    ("drop", "spine"),
    [
        (("spine1", "spine3"), {"spine2"}),
        (("spine2",), {"spine1", "spine3"}),
        ((), {"spine1", "spine2", "spine3"}),
    ],
)
def test_bones_of_the_trunk_spread_over_the_spine(drop: tuple[str, ...], spine: set[str]) -> None:
    assert {joint for joint in found(skeleton(drop=drop)).bone if joint.startswith("spine")} == spine


def test_essential_joints_without_bones_are_named() -> None:
    with pytest.raises(AvatarError, match=r"left_elbow, left_wrist, neither by name nor by place"):
        found(skeleton(drop=("left_elbow", "left_wrist", "left_hand")))


def test_unmapped_bones_follow_their_nearest_mapped_ancestor() -> None:
    bones = skeleton(
        ("eye", "head"), ("thumb_l", "left_wrist"), ("thumb_tip_l", "thumb_l"), ("twist_r", "right_shoulder")
    )
    report = skeleton_report(EVERY, bones, ("neck",))
    assert report.merged == {
        "eye": "head", "thumb_l": "left_hand", "thumb_tip_l": "left_hand", "twist_r": "right_shoulder",
    }  # fmt: skip
    assert report.bone_of_joint == {joint: joint for joint in JOINT_NAMES}
    assert (report.estimated, report.source) == (("neck",), "names")
    np.testing.assert_array_equal(joint_of_bones(EVERY, bones)[:24], np.arange(24))


def test_axes_of_the_file_are_taken_where_the_body_leans_little() -> None:
    axes = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]])
    lean = matrix_from_axis_angle((0.2, 0.0, 0.0))
    np.testing.assert_array_equal(axes_to_smpl(JOINT, tpose_joints_m() @ lean.T @ axes), axes)


def test_body_that_leans_more_is_set_upright() -> None:
    lean = matrix_from_axis_angle((0.0, 0.0, 0.7))
    R = axes_to_smpl(JOINT, tpose_joints_m() @ lean.T)
    up = R @ lean @ np.array([0.0, 1.0, 0.0])
    np.testing.assert_allclose(up, (0, 1, 0), atol=0.03)
    assert np.linalg.det(R) == pytest.approx(1.0)


def test_joints_at_one_place_are_no_skeleton() -> None:
    with pytest.raises(AvatarError, match="no skeleton of a human"):
        axes_to_smpl(JOINT, np.zeros((24, 3)))


def test_missing_joints_are_estimated_near_their_places_and_named() -> None:
    missing = ("left_foot", "right_foot", "left_hand", "left_collar", "neck", "spine2")
    bone = {joint: number for joint, number in JOINT.items() if joint not in missing}
    joints, estimated = smpl_joints(bone, tpose_joints_m(), TOES)
    assert set(estimated) == set(missing)
    assert np.linalg.norm(joints - tpose_joints_m(), axis=1).max() < 0.09
    given = [JOINT[joint] for joint in bone]
    np.testing.assert_array_equal(joints[given], tpose_joints_m()[given])


def test_ankle_on_the_ground_is_lifted_up_the_shin() -> None:
    heads = tpose_joints_m()
    heads[JOINT["left_ankle"]] = (0.10, 0.0, 0.0)
    ankle = smpl_joints(JOINT, heads, TOES)[0][JOINT["left_ankle"]]
    np.testing.assert_allclose(ankle, (0.10, 0.072, 0.0), atol=1e-12)
