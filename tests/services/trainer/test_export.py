import numpy as np
import pytest
import torch
from torch import nn

from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_policy
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import PolicyNet


def trained_looking_model(robot, **network):
    """A network whose normalisations have seen data."""
    torch.manual_seed(3)
    model = PolicyNet(robot, NetworkConfig(**network))
    for module in model.modules():
        if isinstance(module, nn.BatchNorm2d):
            module.running_mean.normal_(0, 0.3)
            module.running_var.uniform_(0.3, 2.0)
            module.weight.data.uniform_(0.5, 1.5)
            module.bias.data.normal_(0, 0.3)
    model.head.layer3.weight.data.mul_(4)
    return model.eval()


@pytest.mark.parametrize("size", [(144, 256), (90, 161), (8, 8)])
def test_exported_graphs_answer_what_torch_answers(tmp_path, size):
    robot = RobotConfig(v_max_mps=0.7, w_max_radps=0.9, camera=CameraConfig(height_px=size[0], width_px=size[1]))
    model = trained_looking_model(robot)
    export_policy(model, PolicySpec(robot=robot), tmp_path)
    policy = load_policy(tmp_path, robot=robot)
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (4, *size, 3), dtype=np.uint8)
    motion = np.array([[0.3, -0.5, 1], [0, 0, 0]], np.float32)
    goals = np.array([[4.0, -2.0], [25.0, 3.0]], np.float32)
    window = torch.tensor([[0, 1, 2], [1, 2, 3]])
    with torch.inference_mode():
        latents = model.encode_windows(torch.from_numpy(images / np.float32(127.5) - 1).permute(0, 3, 1, 2), window)
        answers = model.act(latents, model.normalise_motion(torch.from_numpy(motion)), torch.from_numpy(goals))
        expected = model.clip(model.decide(answers)).numpy()
    ours = policy.encode(images)
    assert np.abs(ours[window].reshape(2, -1) - latents.numpy()).max() < 1e-5
    assert np.abs(policy.act(ours[window].reshape(2, -1), motion, goals) - expected).max() < 1e-5


@pytest.mark.parametrize("output", ["regression", "bins", "weighed"])
def test_actions_stay_within_the_limits(tmp_path, output):
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    model = trained_looking_model(robot, output=output)
    model.head.layer3.weight.data.mul_(100)
    export_policy(model, PolicySpec(robot=robot), tmp_path)
    rng = np.random.default_rng(0)
    latents = rng.normal(0, 3, (300, 60)).astype(np.float32)
    actions = load_policy(tmp_path).act(latents, np.zeros((300, 3), np.float32), np.zeros((300, 2), np.float32))
    tolerance = 1e-5 if output == "regression" else 0.2
    assert actions.min(axis=0).tolist() == pytest.approx([0.0, -1.2], abs=tolerance)
    assert actions.max(axis=0).tolist() == pytest.approx([1.0, 1.2], abs=tolerance)
    assert np.abs(actions[:, 1]).max() <= np.float32(1.2)
    assert actions[:, 0].min() >= 0
    assert actions[:, 0].max() <= 1


def test_equal_weights_give_equal_files(tmp_path):
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    for name in ("a", "b"):
        export_policy(trained_looking_model(robot), PolicySpec(robot=robot), tmp_path / name)
    for file in ("encoder.onnx", "head.onnx", "policy.toml"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == ["encoder.onnx", "head.onnx", "policy.toml"]


def test_policy_that_is_half_replaced_is_not_loaded(tmp_path, monkeypatch):
    robot = RobotConfig(camera=CameraConfig(height_px=8, width_px=8))
    spec = PolicySpec(robot=robot)
    export_policy(trained_looking_model(robot), spec, tmp_path)
    monkeypatch.setattr("readygo.services.trainer.export.HEAD_FILE", "encoder.onnx/head.onnx")
    with pytest.raises(PolicyError, match="cannot be written"):
        export_policy(PolicyNet(robot, NetworkConfig()), spec, tmp_path)
    with pytest.raises(PolicyError, match=r"holds no policy\.toml"):
        load_policy(tmp_path)
