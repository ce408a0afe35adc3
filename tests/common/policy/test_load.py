import pytest

from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_policy, save_spec
from readygo.common.robot import CameraConfig, RobotConfig
from tests.common.policy.artifacts import write_policy


@pytest.fixture
def folder(tmp_path):
    return write_policy(tmp_path)


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


def test_robot_with_another_image_size_is_refused(folder):
    with pytest.raises(PolicyError, match=r"height_px 8 \(the robot's: 144\), width_px 10 \(the robot's: 256\)"):
        load_policy(folder, robot=RobotConfig())


def test_robot_with_another_mount_is_refused(folder):
    robot = RobotConfig(camera=CameraConfig(height_px=8, width_px=10, mount_height_m=0.9))
    with pytest.raises(PolicyError, match=r"another camera: mount_height_m 0\.5 \(the robot's: 0\.9\); ") as caught:
        load_policy(folder, robot=robot)
    assert "\n" not in str(caught.value)
