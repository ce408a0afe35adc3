import math
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.maps import GridFrame, OccupancyMap, sight_of_occupancy
from readygo.common.robot import Clock
from readygo.services.trainer.perception.labels import RAY_MAX_M, free_distances, labels_of

FRAME = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1)


def hall() -> OccupancyMap:
    """12 x 8 m with walls around and a wall from below at x = 6."""
    occupied = np.zeros((80, 120), np.bool_)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[:30, 60:62] = True
    return OccupancyMap(frame=FRAME, occupied=occupied)


def test_rays_end_at_the_first_wall_or_at_the_limit() -> None:
    eyes = np.array([[2.0, 2.0, 0.0], [1.0, 5.0, 0.0]])
    rays_m = free_distances(hall(), eyes, np.array([0.0, math.pi / 2, math.pi]))
    assert rays_m[0] == pytest.approx([4.0, 5.9, 1.9], abs=0.07)
    assert rays_m[1] == pytest.approx([RAY_MAX_M, 2.9, 0.9], abs=0.07)


def recorded() -> SimpleNamespace:
    """A robot that stands, one human who crosses its view, one behind the wall, one behind its back."""
    steps = 40
    humans = np.zeros((steps, 3, 4))
    humans[:, 0, :2] = np.stack([np.full(steps, 5.0), 3.0 + 0.05 * np.arange(steps)], axis=1)
    humans[:, 1, :2] = 8.0, 1.0
    humans[:, 2, :2] = 1.0, 2.0
    poses = np.tile([2.0, 2.0, 0.0, 0.0], (steps, 1))
    return SimpleNamespace(
        poses=poses,
        episode_of_sample=np.zeros(steps, np.int64),
        episodes=[SimpleNamespace(first_sample=0, sample_count=steps)],
        humans_xyzyaw=tuple(humans),
        clock=Clock(),
    )


def test_people_in_view_have_bearing_distance_and_velocity_nearest_first() -> None:
    blocked, camera = hall(), CameraConfig()
    samples = np.array([0, 20])
    labels = labels_of(recorded(), samples, camera, blocked, sight_of_occupancy(blocked))  # type: ignore[arg-type]
    first = labels.people[1, 0]
    bearing, away = math.atan2(2.0, 3.0), math.hypot(3.0, 2.0)
    assert first[:2] == pytest.approx([bearing, away], abs=1e-5)
    # It walks to the left at 1 m/s.
    assert first[2:] == pytest.approx([math.sin(bearing), math.cos(bearing)], abs=1e-4)
    assert labels.visible[1].tolist() == [True] + [False] * 7
    # The one behind the wall is in the view, and hidden; the one behind the robot is no label.
    assert labels.people[1, 1, 1] == pytest.approx(math.hypot(6.0, 1.0), abs=1e-4)
    assert np.isnan(labels.people[1, 2:]).all()


def test_velocity_at_an_episodes_start_is_that_of_its_first_steps() -> None:
    blocked = hall()
    sight = sight_of_occupancy(blocked)
    labels = labels_of(recorded(), np.array([0]), CameraConfig(), blocked, sight)  # type: ignore[arg-type]
    assert math.hypot(*labels.people[0, 0, 2:]) == pytest.approx(1.0, abs=1e-4)
