import numpy as np

from readygo.apps.robot_logs.drives import drive_of, spans
from readygo.apps.robot_logs.reader import Odometry
from readygo.common.robot import RobotConfig, step_unicycle


def straight(seconds: float, speed_mps: float, noise_m: float = 0.0) -> Odometry:
    t = np.arange(0, seconds, 0.02)
    noise = np.random.default_rng(0).normal(0, noise_m, (len(t), 2))
    return Odometry(
        time_ns=np.round(t * 1e9).astype(np.int64),
        xyyaw=np.stack([speed_mps * t + noise[:, 0], noise[:, 1], np.zeros(len(t))], axis=1),
    )


def test_a_gap_in_the_images_ends_an_episode() -> None:
    odometry = straight(20.0, 0.5)
    images_ns = odometry.time_ns[(odometry.time_ns < 9e9) | (odometry.time_ns > 10e9)]
    found = spans(odometry, images_ns, 60.0)
    assert [(round(first / 1e9), round(last / 1e9)) for first, last in found] == [(0, 9), (10, 20)]


def test_long_drives_are_cut_and_short_rests_left_out() -> None:
    odometry = straight(11.0, 0.5)
    assert [round((last - first) / 1e9) for first, last in spans(odometry, odometry.time_ns, 5.0)] == [5, 5]


def test_poses_follow_from_commands_within_the_limits_of_noisy_odometry() -> None:
    robot, odometry = RobotConfig(), straight(10.0, 0.5, noise_m=0.01)
    drive = drive_of(odometry, (0, 9_500_000_000), robot)
    for k in range(len(drive.xyyaw) - 1):
        np.testing.assert_allclose(
            step_unicycle(*drive.xyyaw[k], *drive.actions[k], 0.05), drive.xyyaw[k + 1], atol=1e-9
        )
    assert np.abs(np.diff(drive.actions[:, 0])).max() <= robot.a_max_mps2 * 0.05 + 1e-9
    assert drive.actions[:, 0].max() <= robot.v_max_mps
    assert drive.drift_m < 0.15
