import math

import numpy as np
import pytest

from readygo.common.episode import Purpose, episode_rng
from readygo.common.messages import EpisodeKey, Split
from readygo.common.robot import RobotConfig
from readygo.services.driver import Disturbance, disturbs

ROBOT = RobotConfig(a_max_mps2=2.0, alpha_max_radps2=4.0)
STEPS = 400


def _key(index: int) -> EpisodeKey:
    return EpisodeKey(seed=5, split=Split.TRAIN, index=index)


def _pushes(index: int, **settings: float) -> np.ndarray:
    """What comes on top of an expert that wants to stand still."""
    disturbance = Disturbance(_key(index), ROBOT, late_max_s=0.0, **settings)
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


@pytest.mark.parametrize(("control_hz", "camera_hz", "lags"), [(20, 20, 7), (10, 30, 10), (10, 10, 7), (25, 25, 9)])
def test_command_is_what_was_wanted_some_time_ago_for_the_end_of_the_held_steps_and_a_push(
    control_hz: int, camera_hz: int, lags: int
) -> None:
    """At step t, the expert wants v = 100 t + k and w = -v for the k-th step from there on."""
    robot = RobotConfig(control_hz=control_hz, camera_hz=camera_hz, a_max_mps2=1.7, alpha_max_radps2=4.3)
    clock = robot.clock
    keep = math.exp(-clock.dt_s / 0.35)
    would = [tuple((100.0 * t + k, -100.0 * t - k) for k in range(21)) for t in range(25)]
    found = set()
    for index in range(80):
        disturbance = Disturbance(_key(index), robot, push=0.8, push_time_s=0.35)
        stream = episode_rng(_key(index), Purpose.DISTURBANCE)
        stream.random()
        lag = int(stream.integers(0, lags))
        found.add(lag)
        push = np.zeros(2)
        for t in range(25):
            held = clock.held_for(t)
            push = keep * push + 0.8 * math.sqrt(1 - keep**2) * stream.standard_normal(2)
            wanted = 100.0 * max(t - lag, 0) + min(t, lag) + held - 1
            change = push * clock.dt_s * (1.7, 4.3)
            assert disturbance.command(would[: t + 1], held) == pytest.approx((wanted + change[0], change[1] - wanted))
    assert found == set(range(lags))


def test_last_command_of_a_short_plan_is_held() -> None:
    calm = {"push": 0.0, "late_max_s": 0.0}
    plan = ((0.1, 0.2), (0.3, 0.4), (0.5, 0.6))
    assert [Disturbance(_key(0), ROBOT, **calm).command([plan], held) for held in (1, 3, 9)] == [
        plan[0],
        *[plan[2]] * 2,
    ]


def test_share_of_disturbed_episodes_depends_on_the_key_alone() -> None:
    chosen = {share: [index for index in range(400) if disturbs(_key(index), share)] for share in (0.0, 0.25, 0.5, 1.0)}
    assert [len(indices) for indices in chosen.values()][::3] == [0, 400]
    assert 70 <= len(chosen[0.25]) <= 130
    assert set(chosen[0.25]) < set(chosen[0.5])
