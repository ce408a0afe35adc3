import numpy as np
import pytest

from readygo.common.arrays import Float32Array
from readygo.common.avatars import Avatar, avatar_paths, load_avatars, pose_avatar
from readygo.common.avatars.file import EMBEDDED_FOLDER
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman
from tests.common.rasterizer.drawing import images_of, numbered

AVATARS = load_avatars()
WOMEN, MEN = ("amara", "clara", "elif", "hana"), ("bruno", "dae", "femi", "gil")


@pytest.fixture(params=sorted(AVATARS))
def avatar(request: pytest.FixtureRequest) -> Avatar:
    return AVATARS[request.param]


def test_there_are_four_women_and_four_men_and_their_files_carry_their_names() -> None:
    assert sorted(AVATARS) == sorted(WOMEN + MEN)
    assert [path.stem for path in avatar_paths(None)] == list(AVATARS)


def test_a_child_and_tall_humans_are_among_them() -> None:
    heights_m = sorted(avatar.height_m for avatar in AVATARS.values())
    assert 1.2 <= heights_m[0] < 1.35
    assert 1.85 < heights_m[-1] <= 1.9
    assert np.diff(heights_m)[1:].max() < 0.10


def test_files_are_small() -> None:
    sizes = [path.stat().st_size for path in EMBEDDED_FOLDER.glob("*.npz")]
    assert max(sizes) < 1_500_000
    assert sum(sizes) < 12_000_000


def test_avatar_is_small_free_and_complete(avatar: Avatar) -> None:
    assert 30_000 <= len(avatar.cloud) <= 60_000
    assert "CC0" in avatar.license


def test_skin_weights_are_normalised_and_colours_are_colours(avatar: Avatar) -> None:
    np.testing.assert_allclose(avatar.lbs_weight.sum(axis=1), 1.0, atol=1e-5)
    colour = 0.5 + SH_C0 * avatar.cloud.sh[:, 0]
    assert colour.min() > -0.01
    assert colour.max() < 1.01


def test_soles_are_on_the_ground_and_the_head_at_its_height(avatar: Avatar) -> None:
    y = avatar.cloud.means_m[:, 1]
    assert abs(y.min()) < 0.003
    assert 0.0 <= y.max() - avatar.height_m < 0.08


def test_body_is_symmetric_and_looks_along_z(avatar: Avatar) -> None:
    joints = avatar.joints_canonical_m
    left, right = joints[[1, 4, 7, 16, 18, 20]], joints[[2, 5, 8, 17, 19, 21]]
    np.testing.assert_allclose(left, right * (-1, 1, 1), atol=0.005)
    assert np.all(left[:, 0] > 0.05)
    assert np.all(joints[[10, 11], 2] - joints[[7, 8], 2] > 0.1)


def test_joint_rotations_are_proper_and_feet_keep_theirs(avatar: Avatar) -> None:
    R = avatar.R_tpose_canonical.astype(np.float64)
    np.testing.assert_allclose(R @ R.transpose(0, 2, 1), np.tile(np.eye(3), (24, 1, 1)), atol=1e-5)
    np.testing.assert_allclose(np.linalg.det(R), 1.0, atol=1e-5)
    np.testing.assert_allclose(R[[0, 3, 6, 7, 8, 9, 10, 11, 12, 15]], np.tile(np.eye(3), (10, 1, 1)), atol=1e-6)


def test_zero_pose_is_a_t_with_the_arms_along_x(avatar: Avatar) -> None:
    arm = avatar.joints_tpose_m[20] - avatar.joints_tpose_m[16]
    assert arm[0] / np.linalg.norm(arm) > 0.99
    assert avatar.joints_tpose_m[7, 1] == pytest.approx(avatar.joints_canonical_m[7, 1], abs=0.02)


def test_standing_human_touches_the_floor_and_is_as_wide_as_a_human(avatar: Avatar) -> None:
    pose = np.zeros((24, 3))
    pose[16], pose[17] = (0, 0, -1.3), (0, 0, 1.3)
    cloud = pose_avatar(avatar, (0.0, 0.0, avatar.joints_tpose_m[0, 1]), pose)
    extent = cloud.means_m.max(axis=0) - cloud.means_m.min(axis=0)
    assert abs(cloud.means_m[:, 2].min()) < 0.02
    assert 0.4 < extent[0] < 0.95
    assert 0.2 < extent[1] < 0.5


def run_pose() -> Float32Array:
    """One knee at 90 degrees behind, the other ahead, arms held out to the sides."""
    pose = np.zeros((24, 3), dtype=np.float32)
    pose[1], pose[2], pose[4], pose[5] = (-0.7, 0, 0), (0.3, 0, 0), (0.8, 0, 0), (1.5, 0, 0)
    pose[16], pose[17] = (0, 0, -0.6), (0, 0, 0.6)
    return pose


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_nothing_shines_through_a_runner(avatar: Avatar, side: float) -> None:
    height_px = 400
    K_px = np.array([[800.0, 0, 150], [0, 800.0, 200], [0, 0, 1]])
    T_world_camera = np.eye(4)
    T_world_camera[:3, :3] = np.array([[0, 0, side], [-side, 0, 0], [0, -1, 0]])
    T_world_camera[:3, 3] = (-4.0 * side, 0.0, 0.5 * avatar.height_m)
    rasterizer = CpuRasterizer([], numbered([avatar]), K_px, height_px, 300)
    root_m = np.array([0.0, 0.0, avatar.joints_tpose_m[0, 1]])
    human = PosedHuman(avatar="0", root_m=root_m, pose_axis_angle=run_pose())
    alpha = images_of(rasterizer, T_world_camera, [human], ("alpha",)).alpha
    assert alpha is not None
    around = [np.roll(alpha, shift, axis=(0, 1)) for shift in ((0, 3), (0, -3), (3, 0), (-3, 0), (2, 2), (-2, 2))]
    around += [np.roll(alpha, shift, axis=(0, 1)) for shift in ((2, -2), (-2, -2))]
    inside = np.min(around, axis=0) > 0.98
    assert inside.sum() > 3000
    assert alpha[inside].min() > 0.9


def test_each_human_looks_different() -> None:
    tones = np.array([avatar.cloud.sh[:, 0].mean(axis=0) for avatar in AVATARS.values()])
    distance = np.abs(tones[:, None] - tones[None]).max(axis=2)
    assert distance[~np.eye(len(tones), dtype=bool)].min() > 0.02
