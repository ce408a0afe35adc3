"""A motion is found from noisy poses as smooth as each joint moves, and its errors are known."""

import numpy as np
import pytest

from readygo.common.errors import AvatarError
from readygo.common.frames import matrix_from_axis_angle
from readygo.services.reconstructor.avatars.config import PosePriorConfig
from readygo.services.reconstructor.avatars.trajectory import (
    PoseTrajectory,
    _modes,
    smoothed_trajectory,
    trusted_trajectory,
)

FRAMES, ERROR_RAD, ERROR_M = 80, np.deg2rad(3.0), 0.02
STEADY = PosePriorConfig(drift_deg=0.0, drift_m=0.0)
KNEE, SPINE = 4, 3


def motion() -> tuple[np.ndarray, np.ndarray]:
    """Someone who walks ahead: a knee that bends every 16 frames, a spine that stays as it is."""
    pose, time = np.zeros((FRAMES, 24, 3)), np.arange(FRAMES)
    pose[:, KNEE, 0] = 0.5 * np.sin(2 * np.pi * time / 16)
    pose[:, SPINE, 1] = 0.2
    return pose, np.stack([0.06 * time, np.zeros(FRAMES), np.full(FRAMES, 0.9)], axis=1)


def noisy(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    rng, (pose, root_m) = np.random.default_rng(seed), motion()
    return pose + ERROR_RAD * rng.standard_normal(pose.shape), root_m + ERROR_M * rng.standard_normal(root_m.shape)


def error_deg(trajectory: PoseTrajectory, joint: int) -> float:
    found, true = (matrix_from_axis_angle(each[:, joint]) for each in (trajectory.pose_axis_angle, motion()[0]))
    squares = np.square(found - true).sum(axis=(1, 2)) / 2.0
    return float(np.rad2deg(np.sqrt(squares.mean() / 3.0)))


def stated_deg(trajectory: PoseTrajectory, joint: int) -> float:
    """The standard deviation that a trajectory states of a joint, over all frames."""
    return float(np.rad2deg(np.sqrt(np.square(trajectory.joint_rad[joint]).mean())))


def test_each_joint_is_smoothed_as_it_moves() -> None:
    trajectory = smoothed_trajectory(*noisy(), STEADY)
    assert error_deg(trajectory, SPINE) < 0.7
    assert 0.7 < error_deg(trajectory, KNEE) < 2.0
    moved_m = np.sqrt(np.square(trajectory.root_m - motion()[1]).mean())
    assert moved_m < 0.4 * ERROR_M


@pytest.mark.parametrize("joint", [KNEE, SPINE])
def test_stated_errors_are_those_that_are_made(joint: int) -> None:
    trajectories = [smoothed_trajectory(*noisy(seed), STEADY) for seed in range(8)]
    made = np.sqrt(np.mean([error_deg(each, joint) ** 2 for each in trajectories]))
    stated = np.sqrt(np.mean([stated_deg(each, joint) ** 2 for each in trajectories]))
    assert 0.7 < stated / made < 1.5


def _as_text(count: int) -> list[int]:
    """The order of frames whose numbers are sorted as text: 0, 1, 10, 11, ..."""
    return sorted(range(count), key=str)


def test_frames_that_are_not_in_order_are_refused() -> None:
    pose, root_m = (part[_as_text(FRAMES)] for part in noisy())
    with pytest.raises(AvatarError, match=r"are 0\.\d\d m and 3 deg off .* not in the order of time"):
        smoothed_trajectory(pose, root_m, STEADY)


def test_turns_on_the_spot_that_are_not_in_order_are_refused() -> None:
    pose, root_m = noisy()
    root_m = root_m * (0.0, 1.0, 1.0)
    pose[:, 0, 1] = 0.1 * np.arange(FRAMES)
    assert smoothed_trajectory(pose, root_m, STEADY).root_m.shape == (FRAMES, 3)
    with pytest.raises(AvatarError, match="not in the order of time"):
        smoothed_trajectory(pose[np.random.default_rng(0).permutation(FRAMES)], root_m, STEADY)


def test_a_gap_between_frames_is_no_disorder() -> None:
    pose, root_m = (np.concatenate([part[:30], part[50:]]) for part in noisy())
    assert len(smoothed_trajectory(pose, root_m, STEADY).root_m) == 60


def test_poses_without_errors_stay_as_they_are_and_only_drift_may_move_them() -> None:
    pose, root_m = motion()
    exact = smoothed_trajectory(pose, root_m, STEADY)
    np.testing.assert_allclose(exact.pose_axis_angle, pose, atol=0.02)
    np.testing.assert_allclose(exact.root_m, root_m, atol=1e-6)
    assert stated_deg(exact, SPINE) < 1e-3
    drifting = smoothed_trajectory(pose, root_m, PosePriorConfig(drift_deg=2.0, drift_m=0.01))
    assert np.rad2deg(drifting.joint_rad[SPINE, 0]) == pytest.approx(2.0, abs=0.01)
    assert drifting.modes_m[0] == pytest.approx(0.01, abs=1e-4)
    assert drifting.joint_rad[SPINE, -1] < 0.05 * drifting.joint_rad[SPINE, 0]


def test_trusted_poses_stay_and_their_errors_are_smooth_if_asked() -> None:
    pose, root_m = noisy()
    free = trusted_trajectory(pose, root_m, joint_deg=10.0, root_sd_m=0.05)
    np.testing.assert_array_equal(free.pose_axis_angle, pose)
    np.testing.assert_allclose(free.joint_rad, np.deg2rad(10.0))
    np.testing.assert_allclose(free.modes_m, 0.05)
    smooth = trusted_trajectory(pose, root_m, joint_deg=10.0, root_sd_m=0.05, jerk_deg=2.5, jerk_m=0.01)
    # The fastest course changes its sign from frame to frame: twice its size lies between it and the middle.
    roughness, _ = _modes(FRAMES)
    assert roughness[-1] == pytest.approx(16.0, abs=0.2)
    assert np.rad2deg(smooth.joint_rad[0, -1]) == pytest.approx(1 / np.hypot(1 / 10.0, 2 / 2.5), rel=0.01)
    assert smooth.modes_m[-1] == pytest.approx(1 / np.hypot(1 / 0.05, 2 / 0.01), rel=0.01)
    assert smooth.modes_m[0] == pytest.approx(0.05, rel=1e-3)


def test_modes_are_orthonormal_and_the_slowest_come_first() -> None:
    roughness, modes = _modes(12)
    np.testing.assert_allclose(modes.T @ modes, np.eye(12), atol=1e-9)
    assert (np.diff(roughness) >= -1e-9).all()
    np.testing.assert_allclose(roughness[:2], 0.0, atol=1e-9)


def test_frames_at_uneven_times_are_smoothed_by_their_times() -> None:
    rng = np.random.default_rng(1)
    rows = np.sort(rng.choice(np.arange(FRAMES), FRAMES // 2, replace=False))
    (pose, root_m), true = noisy(), motion()[1][rows]
    by_time, even = (
        smoothed_trajectory(pose[rows], root_m[rows], STEADY, times=times)
        for times in (rows - float(rows[0]), None)
    )  # fmt: skip
    error_m = [float(np.sqrt(np.square(each.root_m - true).mean())) for each in (by_time, even)]
    assert error_m[0] < 0.7 * error_m[1]
    trusted = trusted_trajectory(pose[rows], root_m[rows], joint_deg=5.0, root_sd_m=0.1, jerk_m=0.01, times=rows * 1.0)
    # A motion at one speed costs nothing.
    steady = (rows - rows.mean()) / np.linalg.norm(rows - rows.mean())
    assert np.abs(steady @ trusted.modes[:, 2:]).max() < 1e-6


def test_evenly_spaced_times_change_nothing() -> None:
    pose, root_m = noisy()
    without, with_times = (smoothed_trajectory(pose, root_m, STEADY, times=each) for each in (None, np.arange(80.0)))
    np.testing.assert_allclose(without.root_m, with_times.root_m, atol=1e-12)
