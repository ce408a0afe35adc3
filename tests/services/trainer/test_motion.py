import math

import numpy as np

from readygo.common.policy.motion import own_motion
from readygo.services.trainer.motion import correct_for_turn, corrupt_previous, mirrored_motion, turn_motion, turn_world

POSES = np.array([[[-1.0, 0.2, 0.3], [-0.5, 0.1, 0.2]]])
COMMAND = np.array([[0.5, 0.1]], np.float32)


def test_robot_turned_left_sees_its_goal_on_the_right_and_turns_back():
    yaws_rad = np.array([math.pi / 2, -0.3, 0.0])
    goals = turn_world(np.array([[2.0, 0.0]] * 3, np.float32), yaws_rad)
    commands = np.array([[0.8, 0.1], [0.8, 1.1], [0.8, 1.5]], np.float32)
    assert np.allclose(goals[0], [0.0, -2.0], atol=1e-6)
    corrected = correct_for_turn(commands, yaws_rad, 0.5, 1.2)
    assert np.allclose(corrected, [[0.8, 0.1 - math.pi / 4], [0.8, 1.2], [0.8, 1.5]])


def test_own_motion_of_a_turned_robot_is_that_of_turned_poses():
    present = np.array([[0.2, 0.3, 0.4]])
    yaw = np.array([0.0, 0.0, 0.25])
    turned = turn_motion(own_motion(POSES, present, COMMAND), np.array([0.25]))
    assert np.allclose(turned, own_motion(POSES + yaw, present + yaw, COMMAND), atol=1e-6)


def test_mirrored_motion_is_that_of_mirrored_poses_and_commands():
    present, flip = np.array([[0.2, 0.3, 0.4]]), np.array([1.0, -1.0, -1.0])
    mirrored = own_motion(POSES * flip, present * flip, COMMAND * np.array([1, -1], np.float32))
    assert np.allclose(own_motion(POSES, present, COMMAND) * mirrored_motion(8), mirrored, atol=1e-6)


def test_withheld_previous_action_differs_from_standing_still():
    commands = np.array([[0.5, 0.2], [0.0, 0.0], [0.5, 0.2]], np.float32)
    corrupted = corrupt_previous(commands, np.full((3, 2), 0.1, np.float32), np.array([False, False, True]))
    assert np.allclose(corrupted, [[0.6, 0.3, 1], [0.1, 0.1, 1], [0, 0, 0]])
