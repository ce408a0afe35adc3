"""The skeleton begins as the body's, bends as it, and its lengths and poses follow derivatives."""

import numpy as np
import pytest

from readygo.common.avatars import SMPL_PARENTS, Avatar, joint_transforms
from readygo.services.reconstructor.avatars.config import PosePriorConfig
from readygo.services.reconstructor.avatars.rig import BONES, Rig

FRAMES = 5


@pytest.fixture
def rig(coarse_body: Avatar) -> Rig:
    rng = np.random.default_rng(0)
    root = np.tile([0.0, 0.0, 0.9], (FRAMES, 1))
    return Rig(coarse_body, 0.2 * rng.standard_normal((FRAMES, 24, 3)), root, PosePriorConfig())


def test_begins_as_the_body(rig: Rig, coarse_body: Avatar) -> None:
    posed = rig.pose(2)
    A, B, _ = posed.arrays()
    expected = joint_transforms(coarse_body, rig.values["root"][2], rig.values["pose"][2])
    np.testing.assert_allclose(A, expected, atol=1e-5)
    np.testing.assert_allclose(B, np.tile(np.eye(3, 4), (24, 1, 1)), atol=1e-6)
    assert rig.size == 1.0


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


def test_steps_follow_the_derivative_and_touch_one_frame(rig: Rig) -> None:
    before = rig.values["root"].copy()
    by_A = np.zeros((24, 3, 4), np.float32)
    by_A[:, 0, 3] = 1.0
    for _ in range(3):
        rig.step(1, rig.pose(1), by_A, np.zeros_like(by_A), {"root": 0.01, "pose": 0.01})
    assert rig.values["root"][1, 0] < before[1, 0] - 0.02
    others = [0, 2, 3, 4]
    np.testing.assert_array_equal(rig.values["root"][others], before[others])
    assert (rig.values["bones"] == 0.0).all()


def test_prior_pulls_poses_back(rig: Rig) -> None:
    given = rig.values["root"].copy()
    rig.values["root"][2] += 0.05
    nothing = np.zeros((24, 3, 4), np.float32)
    for _ in range(60):
        rig.step(2, rig.pose(2), nothing, nothing, {"root": 0.003})
    assert np.abs(rig.values["root"][2] - given[2]).max() < 0.02


def test_state_is_restored(rig: Rig, coarse_body: Avatar) -> None:
    rig.step(
        0, rig.pose(0), np.ones((24, 3, 4), np.float32), np.ones((24, 3, 4), np.float32), {"pose": 0.1, "size": 0.1}
    )
    other = Rig(coarse_body, np.zeros((FRAMES, 24, 3)), np.zeros((FRAMES, 3)), PosePriorConfig())
    other.load({name: array.copy() for name, array in rig.state().items()})
    np.testing.assert_array_equal(other.values["pose"], rig.values["pose"])
    assert other.joints().shape == (FRAMES, 24, 3)
    np.testing.assert_array_equal(other.joints(), rig.joints())
