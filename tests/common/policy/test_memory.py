import numpy as np
import pytest

from readygo.common.policy import PolicyMemory
from readygo.common.policy.motion import odometry, own_motion
from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import STEP_NS

STILL = np.zeros(2, np.float32)


def driven(memory, steps):
    """What a simulated robot's memory sees together at every step."""
    windows = []
    for step in range(steps):
        memory.advance(STILL)
        memory.see(np.full(20, step))
        windows.append([int(frame.image[0]) for frame in memory.window()])
    return windows


def test_memory_sees_now_and_one_and_two_spacings_ago():
    assert driven(PolicyMemory(10 * STEP_NS), 31)[-1] == [10, 20, 30]


def test_memory_repeats_the_first_frame_at_the_start():
    windows = driven(PolicyMemory(10 * STEP_NS), 13)
    assert windows[0] == [0, 0, 0]
    assert windows[9] == [0, 0, 9]
    assert windows[12] == [0, 2, 12]


def test_frames_of_an_uneven_camera_are_chosen_by_their_times_not_by_their_number():
    memory = PolicyMemory(500_000_000)
    for millis in (0, 90, 210, 430, 520, 700, 990, 1050):
        memory.see(np.array([millis]), millis * 1_000_000)
    assert [int(frame.image[0]) for frame in memory.window()] == [90, 520, 1050]


def test_frame_before_a_pause_is_kept_for_as_long_as_it_is_the_nearest():
    memory = PolicyMemory(500_000_000)
    for millis in (0, 3000, 3100):
        memory.see(np.array([millis]), millis * 1_000_000)
    assert [int(frame.image[0]) for frame in memory.window()] == [3000, 3000, 3100]


def test_step_without_a_frame_keeps_what_was_seen_and_counts_on():
    memory, command = PolicyMemory(10 * STEP_NS), np.array([0.5, 0.1], np.float32)
    other = PolicyMemory(10 * STEP_NS)
    for step in range(31):
        other.advance(command)
        other.see(STILL)
        memory.advance(command)
        if step % 5 == 0:
            memory.see(np.full(20, step))
    assert [frame.image[0] for frame in memory.window()] == [10, 20, 30]
    assert np.array_equal(memory.own_motion(command), other.own_motion(command))


def test_steps_are_those_of_the_robots_clock():
    clock = RobotConfig(control_hz=30, camera_hz=10).clock
    memory = PolicyMemory(500_000_000, clock=clock)
    for step in range(46):
        memory.advance(np.array([0.6, 0.0], np.float32))
        if step % 3 == 0:
            memory.see(np.full(20, step))
    assert [frame.image[0] for frame in memory.window()] == [15, 30, 45]
    assert np.allclose(memory.own_motion(STILL)[[0, 3]], [-0.6, -0.3], atol=1e-6)


@pytest.mark.parametrize("latency", [0, 3])
def test_memory_knows_where_the_older_frames_were_taken(latency):
    rng = np.random.default_rng(0)
    commands = rng.uniform((0, -1), (1, 1), (40, 2)).astype(np.float32)
    poses, memory = odometry(commands, 0.05), PolicyMemory(6 * STEP_NS, latency * STEP_NS)
    for step in range(40):
        previous = commands[step - 1] if step else STILL
        memory.advance(previous)
        memory.see(STILL)
        rows = [max(step - latency - back, 0) for back in (12, 6)]
        expected = own_motion(poses[None, rows], poses[step][None], previous[None])[0]
        assert np.allclose(memory.own_motion(previous), expected, atol=1e-6)


def test_frame_between_two_poses_was_taken_between_them():
    memory = PolicyMemory(500_000_000, frame_count=2)
    memory.move(0, (0.0, 0.0, 0.0))
    memory.see(STILL, 25_000_000)
    memory.move(100_000_000, (0.4, 0.0, 0.0))
    memory.move(600_000_000, (0.5, 0.0, 0.0))
    memory.see(STILL, 525_000_000)
    assert np.allclose(memory.own_motion(STILL), [-0.4, 0.0, 0.0, 0.0, 0.0])
