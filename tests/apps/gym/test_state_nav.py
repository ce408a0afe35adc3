import numpy as np
import pytest

from readygo.common.errors import ConfigError

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")

SMALL = {"episodes": 16, "static_share": 0.5}
FULL_AHEAD = 40
"""Number of the command straight ahead at full speed."""


def make(count: int, **more):
    return gymnasium.make_vec("readygo.gym:ReadyGo/StateNav-v0", num_envs=count, **SMALL, **more)


def test_ended_robots_begin_again_in_the_next_step() -> None:
    env = make(6)
    observation, _ = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    ended, count = np.zeros(6, bool), 0
    for _ in range(120):
        again = ended.copy()
        observation, rewards, terminated, truncated, info = env.step(np.full(6, FULL_AHEAD))
        assert not rewards[again].any()
        assert (observation[again, 37] == 0.0).all(), "robots begin at rest"
        ended = terminated | truncated
        if ended.any():
            assert info["_success"].tolist() == ended.tolist()
            count += int(ended.sum())
    assert count > 6
    assert env.observation_space.contains(observation)


def test_last_observation_is_told_where_episodes_begin_in_the_same_step() -> None:
    from gymnasium.vector import AutoresetMode

    env = make(4, autoreset_mode=AutoresetMode.SAME_STEP)
    env.reset(seed=0)
    ended = np.zeros(4, bool)
    while not ended.any():
        observation, _, terminated, truncated, info = env.step(np.full(4, FULL_AHEAD))
        ended = terminated | truncated
    k = int(np.flatnonzero(ended)[0])
    assert info["final_obs"][k][37] > 0.0
    assert observation[k, 37] == 0.0


def test_same_seed_repeats_episodes_and_errors() -> None:
    def run() -> np.ndarray:
        env = make(3)
        env.reset(seed=5)
        return np.array([env.step(np.full(3, FULL_AHEAD))[0] for _ in range(20)])

    assert np.array_equal(run(), run())


def test_without_a_seed_every_environment_has_its_episodes() -> None:
    one, other = make(3), make(3)
    first = one.reset()[0]
    assert not np.array_equal(first, other.reset()[0])
    assert not np.array_equal(first, one.reset()[0])
    one.reset(seed=5)
    other.reset(seed=5)
    # A seed also decides the episodes of later calls without one.
    assert np.array_equal(one.reset()[0], other.reset()[0])


def test_one_robot_drives_as_an_environment_of_one() -> None:
    from gymnasium.utils.env_checker import check_env

    env = gymnasium.make("readygo.gym:ReadyGo/StateNav-v0", **SMALL)
    check_env(env.unwrapped, skip_render_check=True)
    env.reset(seed=0)
    ended = False
    while not ended:
        _, reward, terminated, truncated, info = env.step(FULL_AHEAD)
        ended = terminated or truncated
    assert isinstance(reward, float)
    assert set(info) == {"success", "dynamic", "steps"}


def test_truth_is_kept_for_a_critic() -> None:
    assert make(2).unwrapped.truth.shape == (2, 0)
    assert make(2, truth=True).unwrapped.truth.shape[1] > 144


def test_what_cannot_be_is_refused() -> None:
    from gymnasium.vector import AutoresetMode

    from readygo.apps.gym.state_nav import StateNavVectorEnv

    with pytest.raises(ConfigError, match="SAME_STEP"):
        StateNavVectorEnv(autoreset_mode=AutoresetMode.DISABLED)
    with pytest.raises(ConfigError, match="Split"):
        StateNavVectorEnv(split="elsewhere")
