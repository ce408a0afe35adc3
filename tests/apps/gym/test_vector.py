import numpy as np
import pytest

from readygo.common.errors import ConfigError

gymnasium = pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")


def test_robots_drive_side_by_side_and_begin_again_when_they_have_ended():
    from readygo.apps.gym.vector import PointNavVectorEnv

    env = PointNavVectorEnv(num_envs=2, humans=0, image_px=(24, 32))
    observation, infos = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    first = list(infos["episode"])
    assert first == ["train-0-000000", "train-1-000000"]
    ended = np.zeros(2, bool)
    for _ in range(400):
        again = ended.copy()
        observation, rewards, terminated, truncated, infos = env.step(np.tile(np.float32([1.0, 0.0]), (2, 1)))
        assert not rewards[again].any(), "the step in which an episode begins earns nothing"
        ended = terminated | truncated
        if again.any():
            break
    assert [infos["episode"][k] != first[k] for k in range(2)] == again.tolist()
    assert env.observation_space.contains(observation)


def test_make_vec_begins_again_at_once_and_tells_what_was_last():
    from gymnasium.vector import AutoresetMode

    env = gymnasium.make_vec(
        "readygo.gym:ReadyGo/PointNav-v0",
        num_envs=2,
        humans=0,
        image_px=(24, 32),
        autoreset_mode=AutoresetMode.SAME_STEP,
    )
    assert env.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP
    _, infos = env.reset(seed=0)
    first, ended = list(infos["episode"]), np.zeros(2, bool)
    while not ended.any():
        observation, _, terminated, truncated, infos = env.step(np.tile(np.float32([1.0, 0.0]), (2, 1)))
        ended = terminated | truncated
    k = int(np.flatnonzero(ended)[0])
    assert infos["final_info"]["episode"][k] == first[k] != infos["episode"][k]
    assert infos["final_info"]["outcome"][k] != "" == infos["outcome"][k]
    assert env.single_observation_space.contains(infos["final_obs"][k])
    assert not np.array_equal(infos["final_obs"][k]["rgb"], observation["rgb"][k])
    assert observation["velocity"][k].tolist() == [0.0, 0.0]


def test_robots_that_never_begin_again_are_refused():
    from gymnasium.vector import AutoresetMode

    from readygo.apps.gym.vector import PointNavVectorEnv

    with pytest.raises(ConfigError, match="SAME_STEP"):
        PointNavVectorEnv(autoreset_mode=AutoresetMode.DISABLED)
