import numpy as np
import pytest

from readygo.common.episode.conduct import Contact, conduct_of

CONTACT_M = 0.5


def measured(robot_x, human_x, v=None, sees=lambda pose, human: True):
    """A robot and a human on one line: places at all steps and at the end."""
    poses = np.zeros((len(robot_x), 3))
    poses[:, 0] = robot_x
    actions = np.zeros((len(robot_x) - 1, 2))
    actions[:, 0] = np.diff(robot_x) / 0.05 if v is None else v
    humans = np.zeros((len(robot_x), 1, 2))
    humans[:, 0, 0] = human_x
    return conduct_of(poses, actions, humans, dt_s=0.05, contact_m=CONTACT_M, sees=sees)


def test_time_in_personal_space_and_near_misses_are_counted():
    gaps = [1.0, 0.6, 0.4, 0.1, 0.4, 0.6, 0.15, 0.1, 0.7]
    conduct = measured(np.zeros(9), np.array(gaps) + CONTACT_M)
    assert conduct.intrusion_s == pytest.approx(5 * 0.05)
    assert conduct.near_misses == 2
    assert conduct.contact is None


def test_contact_is_no_near_miss_and_says_how_the_robot_met_the_human():
    conduct = measured(np.linspace(0, 1, 21), 1.45, sees=lambda pose, human: pose[0] >= 0.5)
    assert conduct.near_misses == 0
    assert conduct.contact == Contact(robot_mps=pytest.approx(1.0), in_view=True, seen_s=pytest.approx(0.5))
    assert conduct.contact.robot_moved
    assert not conduct.contact.at_fault, "half a second is too short to react"
    assert measured(np.linspace(0, 1, 41), 1.45).contact.at_fault


def test_robot_that_stands_is_not_at_fault():
    conduct = measured(np.zeros(40), np.linspace(2.0, 0.4, 40))
    assert not conduct.contact.robot_moved
    assert not conduct.contact.at_fault


def test_smooth_driving_has_no_jerk_and_jerky_driving_has():
    assert measured(np.arange(20) * 0.05, 9.0).jerk_mps3 == pytest.approx(0.0, abs=1e-9)
    back_and_forth = measured(np.zeros(21), 9.0, v=np.tile([0.0, 0.05], 10))
    assert back_and_forth.jerk_mps3 == pytest.approx(0.1 / 0.05**2)


def test_run_without_humans_or_steps_is_measured():
    nobody = conduct_of(
        np.zeros((3, 3)), np.zeros((2, 2)), np.zeros((3, 0, 2)), dt_s=0.05, contact_m=0.5, sees=lambda *_: True
    )
    assert (nobody.intrusion_s, nobody.near_misses, nobody.contact) == (0.0, 0, None)
    assert measured(np.zeros(1), 2.0).turn_acceleration_radps2 == 0.0
