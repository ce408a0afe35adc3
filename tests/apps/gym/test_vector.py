import numpy as np
import pytest

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
