"""One episode of a driver in the hall."""

import numpy as np

from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.episode.loop import run_episode
from readygo.common.messages import EpisodeKey, EpisodeMotions, HumanMotion, HumanTrajectory, Scenario, Split
from tests.common.episode.upright import upright_motion
from tests.services.evaluator.conftest import ROBOT, hall


def drive(driver, start, goal, tracks=(), occupancy=None):
    """The episode at its end, and the robot's poses, shape (T + 1, 3)."""
    scenario = Scenario(
        episode=EpisodeKey(seed=0, split=Split.TEST, index=0),
        start_xyyaw=np.array(start),
        goal_xy_m=np.array(goal),
        humans=tuple(HumanTrajectory(avatar="a", encounter="crossing", speed_mps=1.0, xy_m=t) for t in tracks),
    )
    motions = EpisodeMotions(humans=tuple(HumanMotion(avatar="a", motion=upright_motion(track)) for track in tracks))
    simulation = EpisodeSimulation(scenario, motions, occupancy or hall(), ROBOT, EpisodeConfig())
    run_episode(simulation, driver)
    return simulation, simulation.path_xyyaw(0, simulation.step)
