import numpy as np
import pytest

from readygo.common.dataset import Dataset, validate
from readygo.common.messages.plan import DriverKind, Outcome
from tests.crooked import LEFT, ODD_RATES, ROBOT, crooked_avatar, crooked_episode, write_crooked_shard


@pytest.mark.parametrize("robot", [ROBOT, ODD_RATES])
def test_crooked_episodes_are_consistent_data(tmp_path, robot):
    write_crooked_shard(tmp_path, (3, 8), robot=robot)
    report = validate(tmp_path)
    assert report.ok, report.defects
    data = Dataset(tmp_path)
    assert data.robot == robot
    assert {entry.outcome for entry in data.episodes} == {Outcome.HUMAN_COLLISION}
    assert {entry.driver for entry in data.episodes} == {DriverKind.POLICY}


def test_commands_are_held_and_images_are_of_two_cameras():
    assert (ROBOT.clock.rate_hz, ROBOT.clock.control_every, ROBOT.clock.image_every) == (20, 2, 1)
    assert (ODD_RATES.clock.rate_hz, ODD_RATES.clock.control_every, ODD_RATES.clock.image_every) == (30, 3, 2)
    header, samples = crooked_episode(robot=ODD_RATES)
    assert [bool(sample.image) for sample in samples[:4]] == [True, False, True, False]
    assert header.cameras[0].width_px == LEFT.width_px
    assert {"depth", "left.rgb", "left.depth"} == set(samples[2].outputs)


def test_no_two_numbers_of_an_episode_are_alike():
    _, samples = crooked_episode()
    numbers = np.abs([*samples[7].robot_xyzyaw, *samples[7].goal_xy_robot_m, *np.ravel(samples[7].humans_xyzyaw)])
    assert (numbers > 0.01).all()
    assert np.diff(np.sort(numbers)).min() > 1e-3


def test_crooked_body_has_wide_legs_that_mirror_each_other():
    joints = crooked_avatar().joints_tpose_m
    assert joints[1, 0] > 0.17
    assert np.allclose(joints[[1, 4, 7, 10]] * [-1, 1, 1], joints[[2, 5, 8, 11]])
