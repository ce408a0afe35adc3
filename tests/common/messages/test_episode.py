import numpy as np
import pytest

from readygo.common.messages import EpisodeKey, HumanTrajectory, Scenario, Split

KEY = EpisodeKey(seed=7, split=Split.VAL, index=3)


def test_name_of_an_episode_sorts_by_its_number() -> None:
    assert KEY.episode_id == "val-7-000003"
    names = [EpisodeKey(seed=7, split=Split.TRAIN, index=index).episode_id for index in (2, 10, 100)]
    assert names == sorted(names)


@pytest.mark.parametrize(("seed", "index"), [(-1, 0), (0, -1)])
def test_negative_numbers_are_refused(seed: int, index: int) -> None:
    with pytest.raises(ValueError, match=f"must not be negative, got {seed} and {index}"):
        EpisodeKey(seed=seed, split=Split.TRAIN, index=index)


def test_places_of_the_wrong_shape_are_refused_with_both_shapes() -> None:
    with pytest.raises(ValueError, match=r"start_xyyaw must have shape \(3,\), got \(4,\)"):
        Scenario(episode=KEY, start_xyyaw=np.zeros(4), goal_xy_m=np.zeros(2), humans=())
    with pytest.raises(ValueError, match=r"goal_xy_m must have shape \(2,\), got \(3,\)"):
        Scenario(episode=KEY, start_xyyaw=np.zeros(3), goal_xy_m=np.zeros(3), humans=())
    with pytest.raises(ValueError, match=r"xy_m must have shape \(None, 2\), got \(5, 3\)"):
        HumanTrajectory(avatar="ann", encounter="crossing", speed_mps=1.0, xy_m=np.zeros((5, 3)))
