import numpy as np

from readygo.common.messages import Outcome
from readygo.services.evaluator.baselines.social_force import SocialForceDriver
from tests.services.evaluator.baselines.driving import drive


def test_goal_behind_a_wall_is_reached():
    simulation, _ = drive(SocialForceDriver(), (1.0, 1.0, 0.0), (10.0, 1.0))
    assert simulation.outcome is Outcome.SUCCESS


def test_human_who_stands_in_the_way_is_passed():
    standing = np.tile([[3.5, 4.5]], (5, 1))
    simulation, path = drive(SocialForceDriver(), (1.0, 4.5, 0.0), (6.0, 4.5), [standing])
    assert simulation.outcome is Outcome.SUCCESS
    assert np.abs(path[:, 1] - 4.5).max() > 0.3


def test_somebody_who_comes_from_the_side_is_kept_away_from():
    crossing = np.stack([np.full(120, 3.5), np.linspace(1.0, 5.5, 120)], axis=1)
    simulation, path = drive(SocialForceDriver(), (1.0, 3.0, 0.0), (6.0, 3.0), [crossing])
    assert simulation.outcome is Outcome.SUCCESS
    gaps = np.hypot(*(path[:, :2] - crossing[np.minimum(np.arange(len(path)), 119)]).T)
    assert gaps.min() > 0.5


def test_who_is_pushed_to_the_wall_does_not_touch_it():
    for speed_mps in (0.6, 1.0, 1.4):
        coming = np.stack([7.0 - speed_mps * np.arange(1000) * 0.05, np.full(1000, 1.0)], axis=1)
        simulation, _ = drive(SocialForceDriver(), (1.0, 0.7, 0.0), (7.5, 0.7), [coming])
        assert simulation.outcome is Outcome.SUCCESS
