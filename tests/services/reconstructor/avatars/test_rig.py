"""The skeleton begins as the body's, bends as it, and its lengths and poses follow derivatives."""

import numpy as np
import pytest

from readygo.common.avatars import SMPL_PARENTS, Avatar, joint_transforms, load_avatars
from readygo.services.reconstructor.avatars.body import scale_body
from readygo.services.reconstructor.avatars.rig import BONES, BoneLengths, Rig, mean_lengths
from readygo.services.reconstructor.avatars.trajectory import PoseTrajectory, trusted_trajectory

FRAMES, WEIGHT = 5, 0.004
SHARES = np.array([0.5, 0.3, 0.2])


@pytest.fixture
def trajectory() -> PoseTrajectory:
    pose = 0.2 * np.random.default_rng(0).standard_normal((FRAMES, 24, 3))
    return trusted_trajectory(pose, np.tile([0.0, 0.0, 0.9], (FRAMES, 1)), joint_deg=3.0, root_sd_m=0.02)


@pytest.fixture
def rig(coarse_body: Avatar, trajectory: PoseTrajectory) -> Rig:
    return Rig(coarse_body, trajectory, WEIGHT)


def test_begins_as_the_body(rig: Rig, coarse_body: Avatar) -> None:
    posed = rig.pose(2)
    A, B, _ = posed.arrays()
    pose, root_m = rig.poses()
    expected = joint_transforms(coarse_body, root_m[2], pose[2])
    np.testing.assert_allclose(A, expected, atol=1e-5)
    np.testing.assert_allclose(B, np.tile(np.eye(3, 4), (24, 1, 1)), atol=1e-6)
    assert rig.size == 1.0


def test_begins_as_the_mean_of_bodies_in_the_size_of_the_first(coarse_body: Avatar, trajectory: PoseTrajectory) -> None:
    bodies = load_avatars()
    others = [bodies["femi"], bodies["gil"], bodies["hana"]]
    begun = Rig(coarse_body, trajectory, WEIGHT, mean_lengths(coarse_body, others, SHARES)).shaped_joints()[0]
    expected = sum(
        share * coarse_body.height_m / each.height_m * _sideless(each.joints_tpose_m)
        for share, each in zip(SHARES, others, strict=True)
    )
    np.testing.assert_allclose(begun - begun[0], expected - expected[0], atol=1e-4)
    assert np.abs(begun - coarse_body.joints_tpose_m).max() > 0.01


def _sideless(joints_m: np.ndarray) -> np.ndarray:
    """Joints whose left and right are the same, and those of the middle in the middle."""
    swapped, mirrored = np.arange(24), np.array([-1.0, 1.0, 1.0])
    for ends in BONES:
        swapped[list(ends)] = ends[::-1]
    joints = joints_m - joints_m[0]
    return 0.5 * (joints + mirrored * joints[swapped])


def test_mean_of_the_body_alone_in_any_size_is_the_body(coarse_body: Avatar) -> None:
    alone, own = mean_lengths(coarse_body, [scale_body(coarse_body, 1.3)], np.ones(1)), BoneLengths.of_body()
    np.testing.assert_allclose(alone.bones, own.bones, atol=1e-6)
    np.testing.assert_allclose(alone.offsets_m, own.offsets_m, atol=1e-6)


def test_longer_thighs_move_knees_and_what_hangs_on_them(rig: Rig, coarse_body: Avatar) -> None:
    thighs = BONES.index((4, 5))
    before = rig.shaped_joints()[0]
    rig.values["bones"][thighs] = np.log(1.2)
    after, canonical, B = rig.shaped_joints()
    for hip, knee in ((1, 4), (2, 5)):
        length = np.linalg.norm(before[knee] - before[hip])
        assert np.linalg.norm(after[knee] - after[hip]) == pytest.approx(1.2 * length)
        middle = 0.5 * (coarse_body.joints_canonical_m[hip] + coarse_body.joints_canonical_m[knee])
        moved = B[hip, :, :3] @ middle + B[hip, :, 3]
        np.testing.assert_allclose(moved, 0.5 * (canonical[hip] + canonical[knee]), atol=1e-5)
    np.testing.assert_allclose(after[15], before[15])


def test_offsets_are_mirrored_and_stay_in_the_middle(rig: Rig) -> None:
    before = rig.shaped_joints()[0]
    rig.values["offsets"][BONES.index((13, 14))] = (0.01, 0.02, 0.03)
    rig.values["offsets"][BONES.index((6,))] = (0.01, 0.0, 0.02)
    moved = rig.shaped_joints()[0] - before
    np.testing.assert_allclose(moved[6], (0.0, 0.0, 0.02), atol=1e-12)
    np.testing.assert_allclose(moved[13] - moved[9], (0.01, 0.02, 0.03), atol=1e-12)
    np.testing.assert_allclose(moved[14] - moved[9], (-0.01, 0.02, 0.03), atol=1e-12)
    np.testing.assert_allclose(moved[20], moved[13], atol=1e-12)


def test_shaped_skeleton_bends_to_its_own_tpose(rig: Rig, coarse_body: Avatar) -> None:
    rig.values["bones"][:] = 0.05 * np.arange(len(BONES)) / len(BONES)
    rig.values["offsets"][:] = 0.01
    rig.values["size"][0] = 0.1
    tpose, canonical, _ = rig.shaped_joints()
    for joint in (1, 4, 7, 13, 16, 18, 20):
        parent = int(SMPL_PARENTS[joint])
        turned = coarse_body.R_tpose_canonical[parent] @ (canonical[joint] - canonical[parent])
        np.testing.assert_allclose(turned, tpose[joint] - tpose[parent], atol=2e-3)


def test_stature_scales_all_joints(rig: Rig) -> None:
    before = rig.shaped_joints()[0]
    rig.values["size"][0] = np.log(1.1)
    np.testing.assert_allclose(rig.shaped_joints()[0], 1.1 * before, atol=1e-9)


def test_steps_follow_the_derivative(rig: Rig) -> None:
    _, before = rig.poses()
    by_A = np.zeros((24, 3, 4), np.float32)
    by_A[:, 0, 3] = 1.0
    for _ in range(3):
        rig.step(rig.pose(1), by_A, np.zeros_like(by_A), {"root": 0.5, "pose": 0.5})
    _, after = rig.poses()
    assert after[1, 0] < before[1, 0] - 0.02
    np.testing.assert_allclose(after[:, 1:], before[:, 1:], atol=1e-9)
    assert (rig.values["bones"] == 0.0).all()


def test_frames_of_a_smooth_motion_tell_of_each_other(coarse_body: Avatar) -> None:
    still = np.zeros((FRAMES, 24, 3)), np.zeros((FRAMES, 3))
    smooth = trusted_trajectory(*still, joint_deg=10.0, root_sd_m=0.05, jerk_deg=0.1, jerk_m=1e-4)
    rig = Rig(coarse_body, smooth, 0.0)
    by_A = np.zeros((24, 3, 4), np.float32)
    by_A[:, 0, 3] = 1.0
    for _ in range(5):
        rig.step(rig.pose(2), by_A, np.zeros_like(by_A), {"root": 0.1})
    moved = rig.poses()[1][:, 0]
    assert moved[2] < -0.005
    np.testing.assert_allclose(moved[1:-1], 0.5 * (moved[:-2] + moved[2:]), atol=5e-4)


def test_poses_are_those_that_are_drawn(rig: Rig, coarse_body: Avatar) -> None:
    rng = np.random.default_rng(1)
    for name in ("pose", "root"):
        rig.values[name] += rng.standard_normal(rig.values[name].shape)
    pose, root_m = rig.poses()
    for frame in range(FRAMES):
        drawn, _, _ = rig.pose(frame).arrays()
        np.testing.assert_allclose(drawn, joint_transforms(coarse_body, root_m[frame], pose[frame]), atol=1e-5)


def test_prior_pulls_motion_back(rig: Rig) -> None:
    rig.values["root"][2] = 2.5
    nothing = np.zeros((24, 3, 4), np.float32)
    for _ in range(60):
        rig.step(rig.pose(2), nothing, nothing, {"root": 0.05})
    assert np.abs(rig.values["root"]).max() < 1.0


def test_state_is_restored(rig: Rig, coarse_body: Avatar, trajectory: PoseTrajectory) -> None:
    rig.step(rig.pose(0), np.ones((24, 3, 4), np.float32), np.ones((24, 3, 4), np.float32), {"pose": 0.1, "size": 0.1})
    other = Rig(coarse_body, trajectory, WEIGHT)
    other.load({name: array.copy() for name, array in rig.state().items()})
    np.testing.assert_array_equal(other.values["pose"], rig.values["pose"])
    assert other.joints().shape == (FRAMES, 24, 3)
    np.testing.assert_array_equal(other.joints(), rig.joints())


def _standing_rig(body: Avatar, weight: float, frames: int = 12) -> Rig:
    """A person who stands, with a pelvis that is given 6 mm off in each frame."""
    root = np.tile([0.0, 0.0, 0.9], (frames, 1)) + np.random.default_rng(3).normal(0.0, 0.006, (frames, 3))
    trajectory = trusted_trajectory(np.zeros((frames, 24, 3)), root, joint_deg=1.0, root_sd_m=0.02)
    return Rig(body, trajectory, 1e-4, contact_weight=weight, contacts_every=20)


def test_soles_that_stand_stay_where_they_are(coarse_body: Avatar) -> None:
    slips = {}
    nothing = np.zeros((24, 3, 4), np.float32)
    for weight in (0.0, 1e-3):
        rig = _standing_rig(coarse_body, weight)
        for step in range(400):
            rig.step(rig.pose(step % 12), nothing, nothing, {"pose": 1e-2, "root": 1e-2})
        balls = rig.joints()[:, [10, 11]]
        slips[weight] = float(np.linalg.norm(np.diff(balls, axis=0), axis=2).mean())
        assert bool(rig.state()["rig_contacts"].any()) == (weight > 0.0)
        resumed = _standing_rig(coarse_body, weight)
        resumed.load({name: array.copy() for name, array in rig.state().items()})
        for each in (rig, resumed):
            each.step(each.pose(3), nothing, nothing, {"pose": 1e-2, "root": 1e-2})
        np.testing.assert_array_equal(resumed.joints(), rig.joints())
    assert slips[1e-3] < 0.5 * slips[0.0]


def test_derivatives_of_standing_are_those_of_finite_differences(coarse_body: Avatar) -> None:
    rig = _standing_rig(coarse_body, 1e-3)
    rig.updates[:] = 20
    posed = rig.pose(4)
    rig._floating.backward()  # type: ignore[no-untyped-call]
    for name in ("size", "bones", "offsets"):
        assert rig._leaves[name].grad is None, "shorter legs would slip less"
    for name, place in (("root", (5, 0)), ("pose", (4, 3, 0))):
        by_value, sides = rig._leaves[name].grad, []
        assert by_value is not None
        for sign in (1.0, -1.0):
            rig.values[name][place] += sign * 1e-4
            rig.updates[:] = 21
            other = rig._leaves
            rig.pose(4)
            sides.append(float(rig._floating.detach()))
            rig._leaves = other
            rig.values[name][place] -= sign * 1e-4
        assert float(by_value[place]) == pytest.approx((sides[0] - sides[1]) / 2e-4, rel=1e-3, abs=1e-4), name
    assert posed.A.shape == (24, 3, 4)
