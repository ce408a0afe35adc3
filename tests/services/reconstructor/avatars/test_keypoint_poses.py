"""Poses are found from keypoints with errors; exchanged sides are repaired, and what is no person is refused."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
import torch

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar
from readygo.common.avatars import Avatar, joint_positions
from readygo.common.errors import AvatarError
from readygo.common.messages import Motion
from readygo.services.reconstructor.avatars.config import AvatarFitConfig
from readygo.services.reconstructor.avatars.footage import read_views
from readygo.services.reconstructor.avatars.keypoint_poses import (
    KeypointPoses,
    PoseFit,
    fit_poses,
    mean_skeleton,
    pose_prior,
)
from readygo.services.reconstructor.avatars.keypoint_start import KeypointViews
from readygo.services.reconstructor.avatars.keypoints import KEYPOINTS_FILE, read_keypoints
from readygo.services.reconstructor.frames.names import times_of_names

FRAMES = 30
CONFIG = AvatarFitConfig()


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory, coarse_body: Avatar) -> Path:
    folder = tmp_path_factory.mktemp("film") / "walk"
    config = AvatarCaptureConfig(
        frames=FRAMES, width_px=160, height_px=160, layout="plain", body="keypoints", keypoint_noise_px=1.0
    )
    capture_avatar(coarse_body, folder, config, lambda _: None)
    return folder


@pytest.fixture(scope="module")
def seen(film: Path) -> KeypointViews:
    views = read_views(film)
    keypoints = read_keypoints(film / KEYPOINTS_FILE, views.images)
    times = times_of_names(views.images)
    return KeypointViews(keypoints=keypoints, K_px=views.K_px, T_world_camera=views.T_world_camera, times=times)


@pytest.fixture(scope="module")
def found(seen: KeypointViews, coarse_body: Avatar) -> KeypointPoses:
    return fit_poses(seen, [coarse_body], CONFIG)


def _joints(found: KeypointPoses, body: Avatar) -> np.ndarray:
    tpose = dataclasses.replace(body, joints_tpose_m=found.joints_tpose_m.astype(np.float32))
    motion = Motion(root_m=found.root_m.astype(np.float32), pose_axis_angle=found.pose_axis_angle.astype(np.float32))
    return joint_positions(tpose, motion)


def test_joints_are_near_the_true_ones(film: Path, found: KeypointPoses, coarse_body: Avatar) -> None:
    error_m = np.linalg.norm(_joints(found, coarse_body) - np.load(film / "truth.npz")["joints_m"], axis=2)
    assert error_m.mean() < 0.07
    assert found.miss_px < 2.0
    assert found.notes == ()


def test_lower_foot_is_on_the_floor(found: KeypointPoses, coarse_body: Avatar) -> None:
    ankles = _joints(found, coarse_body)[:, [7, 8], 2].min(axis=1)
    assert abs(np.median(ankles) - coarse_body.joints_tpose_m[7, 1]) < 0.04


def test_knees_and_elbows_bend_one_way(found: KeypointPoses) -> None:
    for joint, axis, sign in ((4, 0, 1.0), (5, 0, 1.0), (18, 1, -1.0), (19, 1, 1.0)):
        assert (np.rad2deg(sign * found.pose_axis_angle[:, joint, axis]) > -8.0).all()


def test_exchanged_sides_are_repaired_in_some_frames_and_refused_in_most(
    seen: KeypointViews, found: KeypointPoses, coarse_body: Avatar
) -> None:
    swapped = np.zeros((FRAMES, 1), dtype=bool)
    swapped[[4, 5]] = True
    some = dataclasses.replace(seen, keypoints=seen.keypoints.with_swapped(swapped))
    repaired = fit_poses(some, [coarse_body], CONFIG)
    assert "exchanged in 2 of 30 frames" in repaired.notes[0]
    np.testing.assert_array_equal(repaired.root_m, found.root_m)
    most = dataclasses.replace(seen, keypoints=seen.keypoints.with_swapped(np.array([[True]])))
    with pytest.raises(AvatarError, match="exchanged in 30 of 30 frames: left must be the person's left"):
        fit_poses(most, [coarse_body], CONFIG)


def test_sides_that_are_exchanged_wrongly_and_back_do_not_count(
    seen: KeypointViews, coarse_body: Avatar, monkeypatch: pytest.MonkeyPatch
) -> None:
    wrong = np.arange(FRAMES) % 3 > 0
    repair = PoseFit.repair_sides

    def repair_sides(fit: PoseFit) -> None:
        # What the start would leave behind in most frames.
        fit._swap(np.repeat(wrong[:, None], len(seen.keypoints.names), axis=1))
        assert fit.swapped_frames()[wrong].all()
        repair(fit)

    monkeypatch.setattr(PoseFit, "repair_sides", repair_sides)
    assert fit_poses(seen, [coarse_body], CONFIG).notes == ()


def test_other_units_and_other_orders_are_refused(seen: KeypointViews, coarse_body: Avatar) -> None:
    T = seen.T_world_camera.copy()
    T[:, :3, 3] *= 3.0
    with pytest.raises(AvatarError, match="m tall: cameras must be in metres"):
        fit_poses(dataclasses.replace(seen, T_world_camera=T), [coarse_body], CONFIG)
    order = np.random.default_rng(0).permutation(26)
    mixed = dataclasses.replace(seen.keypoints, uv_px=seen.keypoints.uv_px[:, order])
    with pytest.raises(AvatarError):
        fit_poses(dataclasses.replace(seen, keypoints=mixed), [coarse_body], CONFIG)


def test_prior_is_mirrored_and_skeletons_have_one_height(coarse_body: Avatar) -> None:
    mean, sigma = pose_prior()
    np.testing.assert_allclose(mean[17], mean[16] * (1.0, -1.0, -1.0))
    np.testing.assert_allclose(sigma[5], sigma[4])
    small = dataclasses.replace(
        coarse_body, height_m=0.5 * coarse_body.height_m, joints_tpose_m=0.5 * coarse_body.joints_tpose_m
    )
    np.testing.assert_allclose(mean_skeleton([small]), mean_skeleton([coarse_body]), rtol=1e-5)


def test_steady_walk_is_steady_at_the_times_of_its_images_only(seen: KeypointViews, coarse_body: Avatar) -> None:
    kept = np.array([0, 1, 2, 3, 6, 8, 9, 10, 14, 15])
    keypoints = dataclasses.replace(
        seen.keypoints, uv_px=seen.keypoints.uv_px[kept], confidence=seen.keypoints.confidence[kept]
    )
    views = dataclasses.replace(
        seen, keypoints=keypoints, K_px=seen.K_px[kept], T_world_camera=seen.T_world_camera[kept], times=1.0 * kept
    )
    costs = []
    for times in (views.times, np.arange(len(kept), dtype=np.float64)):
        at = dataclasses.replace(views, times=times)
        fit = PoseFit(at, mean_skeleton([coarse_body]), 1.0, CONFIG.prior)
        walked = torch.tensor(kept[:, None] * np.array([0.05, 0.0, 0.0]))
        fit.values["place"] = walked - torch.tensor(at.T_world_camera[:, :3, 3])
        costs.append(float(fit._unsteadiness(fit.values)))
    assert costs[0] < 1e-12
    assert costs[1] > 1.0
