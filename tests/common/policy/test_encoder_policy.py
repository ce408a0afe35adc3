import numpy as np
import onnx
import pytest
from onnx import TensorProto, numpy_helper

from readygo.common.errors import PolicyError
from readygo.common.policy import load_policy
from tests.common.policy.artifacts import linear_graph, write_policy


@pytest.fixture
def folder(tmp_path):
    return write_policy(tmp_path)


def images(count, seed=1):
    return np.random.default_rng(seed).integers(0, 256, (count, 8, 10, 3), dtype=np.uint8)


def test_result_does_not_depend_on_the_batch(folder):
    policy, seen = load_policy(folder), images(5)
    together = policy.encode(seen)
    alone = np.concatenate([policy.encode(image[None]) for image in seen])
    assert np.array_equal(together, alone)


def test_step_equals_encode_and_act_of_each_episode(folder):
    policy, seen = load_policy(folder), images(2)
    previous, goals = np.array([[0.2, 0.1], [0.5, -0.3]], np.float32), np.array([[3, 1], [2, -1]], np.float32)
    actions = policy.step([policy.start(), policy.start()], seen, previous, goals)
    windows = np.tile(policy.encode(seen), (1, 3))
    motion = np.concatenate([np.zeros((2, 6), np.float32), previous], axis=1)
    assert np.array_equal(actions, policy.act(windows, motion, goals))
    assert not np.array_equal(actions[0], actions[1])


def test_head_sees_latents_then_motion_then_goal(folder):
    policy = load_policy(folder)
    weight = numpy_helper.to_array(onnx.load(folder / "head.onnx").graph.initializer[0])
    latents, motion, goal = np.zeros((1, 60)), np.zeros((1, 8)), np.zeros((1, 2))
    motion[0, 6] = 1
    assert np.allclose(policy.act(latents, motion, goal)[0], weight[66])
    assert np.allclose(policy.act(latents, 0 * motion, np.array([[0, 1]]))[0], weight[69])


def test_policy_of_the_first_format_is_given_the_previous_action(tmp_path):
    folder = write_policy(tmp_path)
    head = np.random.default_rng(1).normal(0, 0.1, (64, 2)).astype(np.float32)
    linear_graph(folder / "head.onnx", {"features": (64,)}, TensorProto.FLOAT, "action", head)
    text = (folder / "policy.toml").read_text().replace("readygo-policy/2", "readygo-policy/1")
    (folder / "policy.toml").write_text(text)
    policy, seen = load_policy(folder), images(1)
    previous, goals = np.array([[0.2, 0.1]], np.float32), np.array([[3, 1]], np.float32)
    features = np.concatenate([np.tile(policy.encode(seen), (1, 3)), previous, goals], axis=1)
    assert np.allclose(policy.step([policy.start()], seen, previous, goals), features @ head, atol=1e-5)


def test_images_of_another_size_are_refused(folder):
    with pytest.raises(PolicyError, match=r"8x10 px, got 8x12"):
        load_policy(folder).encode(np.zeros((1, 8, 12, 3), np.uint8))
