import numpy as np
import pytest

from readygo.common.messages import EpisodeKey, Split
from readygo.common.robot import RobotConfig
from readygo.services.driver import Disturbance, DriverConfig, disturbs

ROBOT = RobotConfig(a_max_mps2=2.0, alpha_max_radps2=4.0)
STEPS = 400


def _key(index: int) -> EpisodeKey:
    return EpisodeKey(seed=5, split=Split.TRAIN, index=index)


def _pushes(index: int, **settings: float) -> np.ndarray:
    """What comes on top of an expert that wants to stand still."""
    disturbance = Disturbance(_key(index), DriverConfig(late_max_s=0.0, **settings), ROBOT)
    still = [((0.0, 0.0),) * 21]
    return np.array([disturbance.command(still) for _ in range(STEPS)])


def test_pushes_are_as_strong_and_as_smooth_as_the_settings_say() -> None:
    pushes = np.concatenate([_pushes(index, push=0.5, push_time_s=0.5) for index in range(40)])
    np.testing.assert_allclose(pushes.std(axis=0), 0.5 * 0.05 * np.array([2.0, 4.0]), rtol=0.1)
    np.testing.assert_allclose(pushes.mean(axis=0), 0.0, atol=0.01)
    for axis in pushes.T:
        assert np.corrcoef(axis[:-1], axis[1:])[0, 1] == pytest.approx(np.exp(-0.1), abs=0.02)
    assert abs(np.corrcoef(pushes.T)[0, 1]) < 0.1


def test_episode_has_pushes_of_its_own_and_always_the_same() -> None:
    assert np.array_equal(_pushes(3), _pushes(3))
    assert not np.array_equal(_pushes(3), _pushes(4))
    assert not _pushes(3, push=0.0).any()


def test_command_is_what_was_wanted_for_now_some_time_ago() -> None:
    """At step t, the expert wants v = 100 t + k for the k-th step from there on."""
    would = [tuple((100.0 * t + k, 0.0) for k in range(21)) for t in range(30)]
    lags = set()
    for index in range(60):
        disturbance = Disturbance(_key(index), DriverConfig(push=0.0, late_max_s=0.3), ROBOT)
        commands = [disturbance.command(would[: t + 1])[0] for t in range(30)]
        lag = int(commands[-1] % 100)
        lags.add(lag)
        assert commands == [100.0 * max(t - lag, 0) + min(t, lag) for t in range(30)]
    assert lags == {0, 1, 2, 3, 4, 5, 6}


def test_share_of_disturbed_episodes_depends_on_the_key_alone() -> None:
    chosen = {share: [index for index in range(400) if disturbs(_key(index), share)] for share in (0.0, 0.25, 0.5, 1.0)}
    assert [len(indices) for indices in chosen.values()][::3] == [0, 400]
    assert 70 <= len(chosen[0.25]) <= 130
    assert set(chosen[0.25]) < set(chosen[0.5])
