"""A hall with a pillar, and scenarios in it."""

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import EpisodeKey, EpisodeMotions, HumanMotion, HumanTrajectory, Scenario, Split
from readygo.common.robot import RobotConfig
from tests.common.episode.upright import upright_motion


@pytest.fixture
def hall():
    """10 x 6 m, origin at (-1, -2), walls around, a pillar of one cell at x 4.00..4.05, y 1.00..1.05."""
    occupied = np.zeros((120, 200), np.bool_)
    occupied[[0, -1]] = True
    occupied[:, [0, -1]] = True
    occupied[60, 100] = True
    return OccupancyMap(frame=GridFrame(origin_x_m=-1.0, origin_y_m=-2.0, resolution_m=0.05), occupied=occupied)


@pytest.fixture
def simulate(hall):
    """Makes a simulation from start, goal and human tracks."""

    def make(start=(0.0, 0.0, 0.0), goal=(6.0, 0.0), tracks=(), robot=None, **config):
        tracks = [np.asarray(track, np.float64) for track in tracks]
        scenario = Scenario(
            episode=EpisodeKey(seed=0, split=Split.TEST, index=0),
            start_xyyaw=np.array(start),
            goal_xy_m=np.array(goal),
            humans=tuple(
                HumanTrajectory(avatar="a", encounter="crossing", speed_mps=1.0, xy_m=track) for track in tracks
            ),
        )
        motions = EpisodeMotions(humans=tuple(HumanMotion(avatar="a", motion=upright_motion(t)) for t in tracks))
        return EpisodeSimulation(scenario, motions, hall, robot or RobotConfig(), EpisodeConfig(**config))

    return make
