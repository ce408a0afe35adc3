import dataclasses
import math

import numpy as np
import pytest

from readygo.common.camera import CameraConfig
from readygo.common.episode import EpisodeConfig
from readygo.common.maps import sight_of_occupancy
from readygo.common.robot import RobotConfig
from readygo.common.state_simulation.world import RAY_COUNT, ObservationConfig, make_world


def make(hall, observation: ObservationConfig, robot: RobotConfig | None = None):
    return make_world(hall, sight_of_occupancy(hall), robot or RobotConfig(), EpisodeConfig(), observation)


def test_rays_go_all_round_or_span_the_view(hall) -> None:
    around = make(hall, ObservationConfig()).bearings_rad
    assert np.allclose(np.diff(around), math.tau / RAY_COUNT)
    turned = dataclasses.replace(RobotConfig(), camera=CameraConfig(mount_yaw_deg=10.0))
    within = make(hall, ObservationConfig(rays="view"), turned).bearings_rad
    assert np.degrees(within[[0, -1]]) == pytest.approx([-40.0, 60.0])


def test_numbers_are_those_of_robot_and_task(hall) -> None:
    world = make(hall, ObservationConfig(path=False, people=2))
    assert (world.tells_path, world.told_people, world.dt_s, world.step_limit) == (False, 2, 0.05, 1000)
    assert world.robot.alpha_max_radps2 == RobotConfig().alpha_max_radps2
    assert world.cameras.shape == (1, 8)


def test_people_that_are_told_are_one_to_eight() -> None:
    with pytest.raises(ValueError, match="people"):
        ObservationConfig(people=0)
