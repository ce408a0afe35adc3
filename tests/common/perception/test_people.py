import math

import numpy as np
import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.perception.grid import SHAPE
from readygo.common.perception.people import CHANNELS, PRESENCE, people_at, people_of

CAMERA = CameraConfig(mount_x_m=0.1, mount_yaw_deg=90.0)


def row(bearing: float, distance: float, along: float = 0.0, across: float = 0.0) -> list[float]:
    return [0.9, bearing, distance, along, across, 0.1, 0.2, 0.3, 0.4]


def test_place_and_velocity_are_turned_into_the_robots_frame() -> None:
    people = people_at(np.array([row(0.0, 2.0, 1.0, 0.5), row(math.pi / 2, 3.0)]), CAMERA)
    np.testing.assert_allclose(people.xy_m, [[0.1, 2.0], [-2.9, 0.0]], atol=1e-12)
    np.testing.assert_allclose(people.v_mps[0], [-0.5, 1.0], atol=1e-12)


def test_covariances_lie_along_and_across_the_line_of_sight() -> None:
    people = people_at(np.array([row(0.0, 2.0)]), CAMERA)
    # The line of sight is y: 0.2 of 2 m along it, 0.1 rad of 2 m across it.
    np.testing.assert_allclose(people.place_cov[0], np.diag([0.2**2, 0.4**2]), atol=1e-12)
    np.testing.assert_allclose(people.velocity_cov[0], np.diag([0.4**2, 0.3**2]), atol=1e-12)


def test_of_two_in_one_place_the_first_is_told() -> None:
    people = people_at(np.array([row(0.0, 2.0), row(0.05, 2.1), row(0.5, 2.0)]), CAMERA)
    assert len(people) == 2
    assert people.xy_m[1] == pytest.approx((0.1 - 2 * math.sin(0.5), 2 * math.cos(0.5)))


def test_map_tells_those_above_the_threshold() -> None:
    answers = np.zeros((CHANNELS, *SHAPE))
    answers[:, 4, 7], answers[:, 8, 20] = row(0.3, 1.0), row(-0.3, 4.0)
    answers[PRESENCE, 8, 20] = 0.12
    assert people_of(answers, CAMERA).presence.tolist() == [0.9]
    assert people_of(answers, CAMERA, threshold=0.1).presence.tolist() == [0.9, 0.12]
    assert len(people_of(np.zeros((CHANNELS, *SHAPE)), CAMERA)) == 0
