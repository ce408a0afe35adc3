"""Skinned glTF humans: joints, skin and colours end where they belong, whatever the file's names, axes and unit."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.avatars import SMPL_PARENTS, Avatar, joint_positions, pose_avatar
from readygo.common.avatars.importers import ImportOptions, import_human
from readygo.common.avatars.importers.joints import JOINT, JOINT_NAMES
from readygo.common.errors import AvatarError
from readygo.common.frames import matrix_from_axis_angle, zup_from_yup
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.messages import Motion
from tests.common.avatars.importers.humans import HEIGHT_M, MIXAMO, tpose_joints_m, write_glb

OPTIONS = ImportOptions(license="test", gaussians=4000)
VRM = {
    "pelvis": "J_Bip_C_Hips", "spine1": "J_Bip_C_Spine", "spine2": "J_Bip_C_Chest", "spine3": "J_Bip_C_UpperChest",
    "neck": "J_Bip_C_Neck", "head": "J_Bip_C_Head",
    **{
        f"{side}_{part}": f"J_Bip_{side[0].upper()}_{bone}"
        for side in ("left", "right")
        for part, bone in {
            "hip": "UpperLeg", "knee": "LowerLeg", "ankle": "Foot", "foot": "ToeBase", "collar": "Shoulder",
            "shoulder": "UpperArm", "elbow": "LowerArm", "wrist": "Hand", "hand": "Middle1",
        }.items()
    },
}  # fmt: skip
RIGIFY = {
    "pelvis": "DEF-spine", "spine1": "DEF-spine.001", "spine2": "DEF-spine.002", "spine3": "DEF-spine.003",
    "neck": "DEF-spine.004", "head": "DEF-spine.006",
    **{
        f"{side}_{part}": f"DEF-{bone}.{side[0].upper()}"
        for side in ("left", "right")
        for part, bone in {
            "hip": "thigh", "knee": "shin", "ankle": "foot", "foot": "toe", "collar": "shoulder",
            "shoulder": "upper_arm", "elbow": "forearm", "wrist": "hand", "hand": "f_middle.01",
        }.items()
    },
}  # fmt: skip
UNREAL = {
    "pelvis": "pelvis", "spine1": "spine_01", "spine2": "spine_02", "spine3": "spine_03", "neck": "neck_01",
    "head": "head",
    **{
        f"{side}_{part}": f"{bone}_{side[0]}"
        for side in ("left", "right")
        for part, bone in {
            "hip": "thigh", "knee": "calf", "ankle": "foot", "foot": "ball", "collar": "clavicle",
            "shoulder": "upperarm", "elbow": "lowerarm", "wrist": "hand", "hand": "middle_01",
        }.items()
    },
}  # fmt: skip
SMPL = {joint: f"m_avg_{joint.replace('left_', 'L_').replace('right_', 'R_').title()}" for joint in JOINT_NAMES}


@pytest.fixture(scope="module")
def tpose_human(tmp_path_factory: pytest.TempPathFactory) -> Avatar:
    return import_human(write_glb(tmp_path_factory.mktemp("glb") / "human.glb"), OPTIONS)[0]


def _zup(points: Any) -> Any:
    return zup_from_yup(points).astype(np.float32)


@pytest.mark.parametrize(
    ("names", "prefix"), [(MIXAMO, "mixamorig:"), (MIXAMO, ""), (VRM, ""), (RIGIFY, ""), (UNREAL, ""), (SMPL, "")]
)
def test_all_joints_are_found_by_the_names_of_common_rigs(tmp_path: Path, names: dict[str, str], prefix: str) -> None:
    avatar, report = import_human(write_glb(tmp_path / "p.glb", names=names, prefix=prefix), OPTIONS)
    assert report.skeleton is not None
    assert report.skeleton.source == "names"
    assert report.skeleton.bone_of_joint == {joint: prefix + names[joint] for joint in JOINT_NAMES}
    np.testing.assert_allclose(avatar.joints_canonical_m, tpose_joints_m(), atol=0.01)


def test_humanoid_extension_decides_where_names_say_nothing(tmp_path: Path) -> None:
    names = {joint: f"bone_{number:02d}" for number, joint in enumerate(JOINT_NAMES)}
    bones = {"hips": "pelvis", "neck": "neck", "head": "head"}
    for side in ("left", "right"):
        parts = {"UpperLeg": "hip", "LowerLeg": "knee", "Foot": "ankle", "UpperArm": "shoulder", "LowerArm": "elbow"}
        bones |= {f"{side}{bone}": f"{side}_{part}" for bone, part in (parts | {"Hand": "wrist"}).items()}

    def edit(document: dict[str, Any]) -> None:
        human = {bone: {"node": JOINT[joint] + 1} for bone, joint in bones.items()}
        document["extensions"] = {"VRMC_vrm": {"humanoid": {"humanBones": human}}}

    avatar, report = import_human(write_glb(tmp_path / "p.glb", names=names, prefix="", edit=edit), OPTIONS)
    assert report.skeleton is not None
    assert report.skeleton.source == "humanoid extension"
    assert report.skeleton.bone_of_joint["spine2"] == "bone_06"
    kept = [JOINT[joint] for joint in bones.values()]
    np.testing.assert_allclose(avatar.joints_canonical_m[kept], tpose_joints_m()[kept], atol=0.01)


@pytest.mark.parametrize("turned", [False, True])
def test_geometry_finds_joints_of_nameless_bones(tmp_path: Path, turned: bool) -> None:
    names = {joint: f"bone_{number:02d}" for number, joint in enumerate(JOINT_NAMES)}
    M = np.diag([-1.0, 1.0, -1.0, 1.0]) if turned else None
    path = write_glb(tmp_path / "p.glb", names=names, prefix="", M_world_bind=M, lowered_rad=0.5)
    avatar, report = import_human(path, OPTIONS)
    assert report.skeleton is not None
    assert report.skeleton.source == "geometry"
    limbs = [
        f"{s}_{p}" for s in ("left", "right") for p in ("hip", "knee", "ankle", "foot", "shoulder", "elbow", "wrist")
    ]
    assert {joint: report.skeleton.bone_of_joint[joint] for joint in limbs} == {joint: names[joint] for joint in limbs}
    assert report.skeleton.bone_of_joint["pelvis"] == names["pelvis"]
    assert avatar.joints_canonical_m[JOINT["left_hip"], 0] > 0.05


def test_axes_and_unit_of_the_bind_pose_do_not_matter(tmp_path: Path, tpose_human: Avatar) -> None:
    M = np.eye(4)
    M[:3, :3] = 0.01 * np.array([[1, 0, 0], [0, 0, 1], [0, -1, 0]])
    M[:3, 3] = (0.0, 0.2, 0.0)
    avatar, report = import_human(write_glb(tmp_path / "cm_zup.glb", M_world_bind=M), OPTIONS)
    assert avatar.height_m == pytest.approx(HEIGHT_M, abs=0.01)
    np.testing.assert_allclose(avatar.joints_canonical_m, tpose_human.joints_canonical_m, atol=0.005)
    assert any("0.01" in note for note in report.notes)


def test_bind_pose_counts_and_not_the_pose_that_nodes_rest_in(tmp_path: Path, tpose_human: Avatar) -> None:
    avatar, _ = import_human(write_glb(tmp_path / "posed.glb", posed=True), OPTIONS)
    np.testing.assert_allclose(avatar.joints_canonical_m, tpose_human.joints_canonical_m, atol=1e-5)


def test_tpose_of_a_tpose_figure_is_the_figure(tpose_human: Avatar) -> None:
    root = _zup(tpose_human.joints_tpose_m[0])
    pose = np.zeros((24, 3))
    posed = pose_avatar(tpose_human, root, pose).means_m
    # The file's arms and legs are straight, SMPL's are bent by a few degrees.
    moved = np.linalg.norm(posed - _zup(tpose_human.cloud.means_m), axis=1)
    assert moved.max() < 0.12
    trunk = tpose_human.lbs_index[:, 0] == JOINT["spine3"]
    assert moved[trunk].max() < 0.012
    assert posed[:, 2].min() == pytest.approx(0.0, abs=0.01)


def test_tpose_of_an_apose_figure_puts_joints_and_skin_on_the_tpose(tmp_path: Path, tpose_human: Avatar) -> None:
    avatar, _ = import_human(write_glb(tmp_path / "apose.glb", lowered_rad=0.8), OPTIONS)
    np.testing.assert_allclose(avatar.joints_tpose_m, tpose_human.joints_tpose_m, atol=0.01)
    motion = Motion(root_m=_zup(avatar.joints_tpose_m[:1]), pose_axis_angle=np.zeros((1, 24, 3), np.float32))
    np.testing.assert_allclose(joint_positions(avatar, motion)[0], _zup(avatar.joints_tpose_m), atol=1e-5)
    posed = pose_avatar(avatar, motion.root_m[0], motion.pose_axis_angle[0]).means_m
    arms = np.isin(avatar.lbs_index[:, 0], [JOINT["left_elbow"], JOINT["right_elbow"]])
    shoulder_z = avatar.joints_tpose_m[JOINT["left_shoulder"], 1]
    assert np.abs(posed[arms, 2] - shoulder_z).max() < 0.12
    assert (avatar.cloud.means_m[arms, 1] < shoulder_z - 0.1).all()


def test_bent_knee_moves_only_what_lies_below(tpose_human: Avatar) -> None:
    root = _zup(tpose_human.joints_tpose_m[0])
    pose = np.zeros((24, 3))
    straight = pose_avatar(tpose_human, root, pose).means_m.astype(np.float64)
    pose[JOINT["left_knee"], 0] = 1.0
    bent = pose_avatar(tpose_human, root, pose).means_m.astype(np.float64)
    below = np.isin(tpose_human.lbs_index[:, 0], [JOINT["left_knee"], JOINT["left_ankle"], JOINT["left_foot"]])
    np.testing.assert_allclose(bent[~below], straight[~below], atol=1e-6)
    knee = _zup(tpose_human.joints_tpose_m[JOINT["left_knee"]])
    R = matrix_from_axis_angle(zup_from_yup((1.0, 0.0, 0.0)))
    np.testing.assert_allclose(bent[below], (straight[below] - knee) @ R.T + knee, atol=1e-5)


def test_colours_come_from_the_texture(tpose_human: Avatar) -> None:
    rgb = 0.5 + SH_C0 * tpose_human.cloud.sh[:, 0]
    legs = np.isin(tpose_human.lbs_index[:, 0], [JOINT["left_knee"], JOINT["right_knee"]])
    arms = np.isin(tpose_human.lbs_index[:, 0], [JOINT["left_elbow"], JOINT["right_elbow"]])
    assert (rgb[legs, 2] > 0.6).all()
    assert (rgb[legs, 0] < 0.2).all()
    assert (rgb[arms, 0] > 0.6).all()
    assert (rgb[arms, 2] < 0.2).all()


def test_without_texture_the_base_colour_stands_in_and_is_noted(tmp_path: Path) -> None:
    avatar, report = import_human(write_glb(tmp_path / "plain.glb", texture=False), OPTIONS)
    rgb = 0.5 + SH_C0 * avatar.cloud.sh[:, 0]
    assert (rgb[:, 1] > 0.8).all()
    assert (rgb[:, [0, 2]] < 0.01).all()
    assert any("no texture" in note for note in report.notes)


def test_thin_axis_of_gaussians_is_the_normal(tpose_human: Avatar) -> None:
    from readygo.common.frames import matrix_from_quat

    thin = matrix_from_quat(tpose_human.cloud.quats_wxyz)[:, :, 2]
    assert (np.abs(thin).max(axis=1) > 0.99).all()
    scales = tpose_human.cloud.scales_m
    assert (scales[:, 2] < 0.2 * scales[:, 0]).all()


def test_missing_bones_are_estimated_and_reported(tmp_path: Path) -> None:
    drop = ("left_foot", "right_foot", "left_hand", "right_hand", "left_collar", "right_collar", "neck", "spine2")
    avatar, report = import_human(write_glb(tmp_path / "p.glb", drop=drop), OPTIONS)
    assert report.skeleton is not None
    assert set(report.skeleton.estimated) == set(drop)
    want = tpose_joints_m()
    for joint in drop:
        assert np.linalg.norm(avatar.joints_canonical_m[JOINT[joint]] - want[JOINT[joint]]) < 0.09, joint


@pytest.mark.parametrize("foot_share", [0.3, 1.0, 1.5])
def test_foot_without_a_bone_of_its_own_is_as_long_as_its_skin(tmp_path: Path, foot_share: float) -> None:
    path = write_glb(tmp_path / "p.glb", drop=("left_foot", "right_foot"), foot_share=foot_share)
    joints = import_human(path, OPTIONS)[0].joints_canonical_m
    for side in ("left", "right"):
        ankle, foot = joints[JOINT[f"{side}_ankle"]], joints[JOINT[f"{side}_foot"]]
        assert 0.6 < (foot[2] - ankle[2]) / (0.19 * foot_share - ankle[2]) < 0.8


def test_wrong_size_asks_for_the_height_and_takes_it(tmp_path: Path) -> None:
    def edit(document: dict[str, Any]) -> None:
        document["nodes"].append({"name": "root", "scale": [10, 10, 10], "children": [0, 1]})

    path = write_glb(tmp_path / "giant.glb", edit=edit)
    with pytest.raises(AvatarError, match=r"17\.5\d* m tall.*--height-m"):
        import_human(path, OPTIONS)
    avatar, _ = import_human(path, ImportOptions(license="test", gaussians=4000, height_m=1.6))
    assert avatar.height_m == pytest.approx(1.6, abs=1e-4)
    np.testing.assert_allclose(avatar.joints_canonical_m, tpose_joints_m() * 1.6 / HEIGHT_M, atol=0.01)


def test_same_file_gives_the_same_avatar(tmp_path: Path, tpose_human: Avatar) -> None:
    from readygo.common.avatars import avatar_hash

    again, _ = import_human(write_glb(tmp_path / "human.glb"), OPTIONS)
    assert avatar_hash(again) == avatar_hash(tpose_human)


def test_skeleton_of_the_avatar_has_smpls_parents(tpose_human: Avatar) -> None:
    lengths = np.linalg.norm(tpose_human.joints_tpose_m[1:] - tpose_human.joints_tpose_m[SMPL_PARENTS[1:]], axis=1)
    want = np.linalg.norm(tpose_joints_m()[1:] - tpose_joints_m()[SMPL_PARENTS[1:]], axis=1)
    np.testing.assert_allclose(lengths, want, atol=1e-3)


def test_figure_without_triangles_is_refused(tmp_path: Path) -> None:
    def edit(document: dict[str, Any]) -> None:
        del document["meshes"][0]["primitives"][0]["attributes"]["POSITION"]

    with pytest.raises(AvatarError, match="no skinned triangles"):
        import_human(write_glb(tmp_path / "p.glb", edit=edit), OPTIONS)


def test_json_of_another_shape_is_refused_in_one_line(tmp_path: Path) -> None:
    def edit(document: dict[str, Any]) -> None:
        document["nodes"][3]["rotation"] = "sideways"

    with pytest.raises(AvatarError, match="not valid glTF") as raised:
        import_human(write_glb(tmp_path / "p.glb", edit=edit), OPTIONS)
    assert "\n" not in str(raised.value)


def test_imported_human_is_as_it_was(tmp_path: Path, golden_figures) -> None:
    avatar, _ = import_human(write_glb(tmp_path / "a.glb", names=MIXAMO), ImportOptions(license="test", gaussians=1500))
    cloud = avatar.cloud
    golden_figures("avatars/imported", 5.0 * cloud.means_m, cloud.quats_wxyz, 50.0 * cloud.scales_m, cloud.sh[:, 0])
    golden_figures("avatars/imported skin", avatar.lbs_weight, 0.3 * avatar.lbs_index)
    golden_figures("avatars/imported joints", 5.0 * avatar.joints_tpose_m, avatar.R_tpose_canonical)
