import dataclasses
import subprocess
import sys

import numpy as np
import onnx
import pytest
from onnx import TensorProto, numpy_helper

from readygo.common.camera import SensorConfig
from readygo.common.errors import PolicyError
from readygo.common.policy import (
    PolicySpec,
    check_policy_camera,
    check_policy_limits,
    load_policy,
    save_spec,
)
from readygo.common.robot import CameraConfig, RobotConfig
from tests.common.policy.artifacts import CAMERA, ROBOT, linear_graph, write_policy


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


def test_robot_with_another_image_size_is_refused(folder):
    with pytest.raises(PolicyError, match=r"height_px 8 \(the robot's: 144\), width_px 10 \(the robot's: 256\)"):
        load_policy(folder, robot=RobotConfig())


def test_robot_with_another_mount_is_refused(folder):
    robot = RobotConfig(camera=CameraConfig(height_px=8, width_px=10, mount_height_m=0.9))
    with pytest.raises(PolicyError, match=r"another camera: mount_height_m 0\.5 \(the robot's: 0\.9\); ") as caught:
        load_policy(folder, robot=robot)
    assert "\n" not in str(caught.value)


def test_another_lens_and_another_variation_are_named_field_by_field():
    lens = dataclasses.replace(CAMERA, distortion="brown_conrady", k1=-0.02)
    spec = PolicySpec(robot=RobotConfig(camera=lens), sensor=SensorConfig(k1=(-0.04, 0.0)))
    check_policy_camera(spec, RobotConfig(v_max_mps=0.5, camera=lens), SensorConfig(k1=(-0.04, 0.0)))
    check_policy_camera(spec, RobotConfig(camera=lens))
    with pytest.raises(
        PolicyError, match=r"distortion brown_conrady \(the robot's: none\), k1 -0\.02 \(the robot's: 0\);"
    ):
        check_policy_camera(spec, ROBOT)
    with pytest.raises(
        PolicyError, match=r"camera: sensor\.k1 \[-0\.04, 0\.0\] \(the robot's: none\); .*--camera robot"
    ):
        check_policy_camera(spec, RobotConfig(camera=lens), SensorConfig())


def test_robot_of_other_limits_is_named_limit_by_limit_and_another_body_is_none():
    spec = PolicySpec(robot=ROBOT)
    check_policy_limits(spec, dataclasses.replace(ROBOT, height_m=1.5, camera=CameraConfig()))
    slow = dataclasses.replace(ROBOT, v_max_mps=0.5, a_max_mps2=2.0)
    with pytest.raises(
        PolicyError, match=r"v_max_mps 1 \(the robot's: 0\.5\), a_max_mps2 1 \(the robot's: 2\); "
    ) as caught:
        check_policy_limits(spec, slow)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("name", ["encoder.onnx", "head.onnx", "policy.toml"])
def test_missing_file_is_named(folder, name):
    (folder / name).unlink()
    with pytest.raises(PolicyError, match=name):
        load_policy(folder)


def test_broken_graph_is_named_in_one_line(folder):
    (folder / "head.onnx").write_bytes(b"not a graph")
    with pytest.raises(PolicyError, match=r"head\.onnx") as caught:
        load_policy(folder)
    assert "\n" not in str(caught.value)


def test_graphs_that_do_not_fit_the_spec_are_refused(folder):
    save_spec(PolicySpec(robot=RobotConfig()), folder)
    with pytest.raises(PolicyError, match="do not fit"):
        load_policy(folder)


def test_importing_the_package_loads_neither_torch_nor_onnxruntime():
    code = "import sys, readygo.common.policy; assert not {'torch', 'onnxruntime', 'onnx', 'cv2'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
