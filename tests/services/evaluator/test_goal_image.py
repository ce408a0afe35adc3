import numpy as np
import pytest

from readygo.services.evaluator.goal_image import goal_image
from tests.services.evaluator.baselines.driving import drive


class Eyes:
    def look_from(self, poses, episode):
        self.poses = poses
        return np.full((1, 6, 16, 3), 200, np.uint8)


class Still:
    """Looks at the goal, and stays where it is."""

    looks = False

    def __init__(self, eyes):
        self._eyes = eyes

    def start(self, simulation):
        self.image = goal_image(self._eyes, simulation)

    def commands(self, running):
        return [(0.0, 0.0) for _ in running]


def test_image_is_taken_at_the_goal_by_a_robot_that_has_come_the_shortest_way():
    eyes = Eyes()
    still = Still(eyes)
    drive(still, (1.0, 1.0, 2.0), (4.0, 1.0))
    assert eyes.poses == [(4.0, 1.0, pytest.approx(0.0, abs=0.05))]
    assert still.image.shape == (6, 16, 3)
