import math

import numpy as np
import pytest

from readygo.apps.robot_logs.drives import _follow, drive_of, spans
from readygo.apps.robot_logs.reader import LoggedPoses
from readygo.common.robot import RobotConfig, limit_command, step_unicycle

MS = 1_000_000


def straight(seconds: float, speed_mps: float, noise_m: float = 0.0) -> LoggedPoses:
    t = np.arange(0, seconds, 0.02)
    noise = np.random.default_rng(0).normal(0, noise_m, (len(t), 2))
    return LoggedPoses(
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


def driven(speeds_mps, turns_radps, every_ms=10, start=(-3.2, 7.1, 2.5), begin_ns=5_000 * MS):
    """Odometry of a robot with these speeds, step by step."""
    poses, dt_s = [start], every_ms / 1000
    for v, w in zip(speeds_mps, turns_radps, strict=True):
        poses.append(step_unicycle(*poses[-1], v, w, dt_s))
    return LoggedPoses(time_ns=begin_ns + every_ms * MS * np.arange(len(poses)), xyyaw=np.array(poses))


@pytest.mark.parametrize(("gap_ms", "count"), [(500, 1), (501, 2)])
@pytest.mark.parametrize("of", ["images", "poses"])
def test_messages_half_a_second_apart_belong_to_one_episode(gap_ms, count, of):
    odometry = driven([0.5] * 1200, [0.1] * 1200)
    times_ns = odometry.time_ns
    kept = (times_ns <= times_ns[600]) | (times_ns >= times_ns[600] + gap_ms * MS)
    sparse = np.sort(np.append(times_ns[kept], times_ns[600] + gap_ms * MS)) if gap_ms % 10 else times_ns[kept]
    if of == "images":
        found = spans(odometry, sparse, 60.0)
    else:
        poses = np.stack([np.interp(sparse, times_ns, column) for column in odometry.xyyaw.T], axis=1)
        found = spans(LoggedPoses(time_ns=sparse, xyyaw=poses), times_ns, 60.0)
    assert len(found) == count
    assert found[0][0] == times_ns[0]
    if count == 2:
        assert found[0][1] == times_ns[600] - 50 * MS, "no sample looks at what comes too late"
        assert 0 <= found[1][0] - (times_ns[600] + gap_ms * MS) < 50 * MS


def test_episodes_begin_and_end_where_poses_and_images_are():
    odometry = driven([0.5] * 1000, [0.0] * 1000)
    images_ns = odometry.time_ns[70:900:5]
    ((first, last),) = spans(odometry, images_ns, 60.0)
    assert (first, last) == (images_ns[0], images_ns[0] + (images_ns[-1] - images_ns[0]) // (50 * MS) * 50 * MS)
    assert spans(odometry, images_ns[:0], 60.0) == []


def test_longest_episode_is_cut_to_the_step():
    odometry = driven([0.6] * 1100, [0.0] * 1100)
    begin_ns = int(odometry.time_ns[0])
    assert spans(odometry, odometry.time_ns, 4.0) == [
        (begin_ns, begin_ns + 79 * 50 * MS),
        (begin_ns + 80 * 50 * MS, begin_ns + 159 * 50 * MS),
        (begin_ns + 160 * 50 * MS, begin_ns + 220 * 50 * MS),
    ]


@pytest.mark.parametrize(
    ("speed_mps", "turn_radps", "stands"),
    [(0.0, 0.0, True), (0.028, 0.045, True), (0.032, 0.0, False), (0.0, 0.055, False), (-0.032, 0.0, False)],
)
def test_rest_is_slow_in_both_speeds(speed_mps, turn_radps, stands):
    speeds, turns = [0.5] * 400 + [speed_mps] * 400 + [0.5] * 400, [0.0] * 400 + [turn_radps] * 400 + [0.0] * 400
    assert len(spans(driven(speeds, turns), driven(speeds, turns).time_ns, 60.0)) == (2 if stands else 1)


@pytest.mark.parametrize(("rest_s", "count"), [(1.9, 1), (2.15, 2)])
def test_rest_of_two_seconds_ends_an_episode(rest_s, count):
    speeds = [0.5] * 400 + [0.0] * round(100 * rest_s) + [0.5] * 400
    odometry = driven(speeds, [0.0] * len(speeds))
    assert len(spans(odometry, odometry.time_ns, 60.0)) == count


@pytest.mark.parametrize(
    ("steps", "speed_mps", "kept"), [(40, 0.6, True), (39, 0.6, False), (60, 0.34, True), (60, 0.33, False)]
)
def test_episodes_of_less_than_two_seconds_or_one_metre_are_left_out(steps, speed_mps, kept):
    odometry = driven([speed_mps] * 5 * steps, [0.3] * 5 * steps)
    assert bool(spans(odometry, odometry.time_ns, 60.0)) == kept


def test_command_follows_the_odometry_and_leads_back_to_it():
    """Kanayama's control law, with the errors in the robot's frame written out."""
    rng, dt_s = np.random.default_rng(4), 0.05
    for _ in range(20):
        pose, here, following = rng.uniform(-2, 2, (3, 3))
        turn = following[2] - here[2]
        middle = here[2] + turn / 2
        v = ((following[0] - here[0]) * math.cos(middle) + (following[1] - here[1]) * math.sin(middle)) / dt_s
        dx, dy, c, s = here[0] - pose[0], here[1] - pose[1], math.cos(pose[2]), math.sin(pose[2])
        x_e, y_e, yaw_e = c * dx + s * dy, c * dy - s * dx, here[2] - pose[2]
        want = v * math.cos(yaw_e) + 2.0 * x_e, turn / dt_s + v * 4.0 * y_e + 3.0 * yaw_e
        assert _follow(tuple(pose), here, following, dt_s) == pytest.approx(want)


def test_crooked_drive_is_followed_at_the_robots_own_rate():
    robot = RobotConfig(v_min_mps=-0.3, control_hz=10, camera_hz=15, v_max_mps=0.9, w_max_radps=0.8)
    phase = np.arange(900) / 100
    odometry = driven(0.3 + 0.3 * np.sin(phase), 0.5 * np.cos(0.7 * phase))
    begin_ns = int(odometry.time_ns[0])
    drive = drive_of(odometry, (begin_ns + 100 * MS, begin_ns + 7_733 * MS), robot)
    assert drive.clock == robot.clock
    assert robot.clock.rate_hz == 30
    assert (len(drive.xyyaw), len(drive.actions), drive.start_ns) == (228, 228, begin_ns + 100 * MS)
    assert drive.times_ns[[0, 1, 3, 227]].tolist() == [
        begin_ns + 100 * MS + robot.clock.time_ns(step) for step in (0, 1, 3, 227)
    ]
    measured = np.stack([np.interp(drive.times_ns, odometry.time_ns, column) for column in odometry.xyyaw.T], axis=1)
    assert np.abs(drive.xyyaw - measured).max() < 0.02
    assert drive.drift_m == pytest.approx(np.linalg.norm(drive.xyyaw[:, :2] - measured[:, :2], axis=1).max())
    for k in range(227):
        pose = step_unicycle(*drive.xyyaw[k], *drive.actions[k], 1 / 30)
        np.testing.assert_allclose(pose, drive.xyyaw[k + 1], atol=1e-9)
        held = limit_command(*drive.actions[k + 1], *drive.actions[k], robot, 1 / 30)
        np.testing.assert_allclose(held, drive.actions[k + 1], atol=1e-9)
