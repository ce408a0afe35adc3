import numpy as np
import onnxruntime
import pytest
import torch
from torch import nn

from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, load_policy
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.export import export_policy, policy_graph
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
def test_exported_graph_answers_what_torch_answers(tmp_path, size):
    robot = RobotConfig(v_max_mps=0.7, w_max_radps=0.9, camera=CameraConfig(height_px=size[0], width_px=size[1]))
    model = trained_looking_model(robot)
    export_policy(model, PolicySpec(robot=robot), tmp_path)
    policy = load_policy(tmp_path, robot=robot)
    rng = np.random.default_rng(0)
    images = rng.integers(0, 256, (30, *size, 3), dtype=np.uint8)
    commands = rng.uniform(-0.9, 0.7, (30, 2)).astype(np.float32)
    goals = rng.uniform(-12, 12, (30, 2)).astype(np.float32)
    window = torch.tensor([[max(step - back, 0) for back in (20, 10, 0)] for step in range(30)])
    with torch.inference_mode():
        motion = torch.from_numpy(np.column_stack([commands, np.ones(30, np.float32)]))
        frames = torch.from_numpy(images / np.float32(127.5) - 1).permute(0, 3, 1, 2)
        latents = model.encode_windows(frames, window)
        answers = model.act(latents, model.normalise_motion(motion), torch.from_numpy(goals))
        expected = model.clip(model.decide(answers)).numpy()
    memory = policy.start()
    for step in range(30):
        now = slice(step, step + 1)
        assert np.abs(policy.step([memory], images[now], commands[now], goals[now]) - expected[now]).max() < 1e-5
    seen = [frame.cached["latents"] for frame in memory.window()]
    assert np.abs(np.concatenate(seen) - latents[-1].numpy()).max() < 1e-5


@pytest.mark.parametrize("output", ["regression", "bins", "weighed"])
def test_actions_stay_within_the_limits(output):
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    model = trained_looking_model(robot, output=output)
    model.head.layer3.weight.data.mul_(100)
    session = onnxruntime.InferenceSession(policy_graph(model, robot, 0.5), providers=["CPUExecutionProvider"])
    rng = np.random.default_rng(0)
    given = {
        "rgb": np.empty((0, 16, 16, 3), np.uint8),
        "window": np.arange(3),
        "command": np.zeros((1, 2), np.float32),
        "goal": np.zeros((1, 2), np.float32),
    }
    drawn = rng.normal(0, 3, (300, 3, 20)).astype(np.float32)
    actions = np.concatenate([session.run(["action"], {**given, "latents": latents})[0] for latents in drawn])
    tolerance = 1e-5 if output == "regression" else 0.2
    assert actions.min(axis=0).tolist() == pytest.approx([0.0, -1.2], abs=tolerance)
    assert actions.max(axis=0).tolist() == pytest.approx([1.0, 1.2], abs=tolerance)
    assert np.abs(actions[:, 1]).max() <= np.float32(1.2)
    assert actions[:, 0].min() >= 0
    assert actions[:, 0].max() <= 1


@pytest.mark.parametrize("output", ["bins", "weighed"])
def test_graph_tells_its_best_command_that_moves(output):
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    model = trained_looking_model(robot, output=output)
    with torch.no_grad():
        model.head.layer3.bias[: len(model.bins.centres)] += torch.where(model.bins.centres[:, 0] == 0.0, 2.0, 0.0)
    session = onnxruntime.InferenceSession(policy_graph(model, robot, 0.5), providers=["CPUExecutionProvider"])
    given = {"rgb": np.empty((0, 16, 16, 3), np.uint8), "window": np.arange(3)}
    given |= {name: np.zeros((1, 2), np.float32) for name in ("command", "goal")}
    drawn = np.random.default_rng(0).normal(0, 3, (100, 3, 20)).astype(np.float32)
    told = [session.run(["action", "moving"], {**given, "latents": latents}) for latents in drawn]
    action, moving = np.concatenate(told, axis=1)
    slowest = float(model.bins.steps[0]) * robot.v_max_mps
    stands = action[:, 0] < 0.5 * slowest
    assert stands.sum() > 10
    assert moving[:, 0].min() >= slowest - 1e-6
    # A command far from standing is the same: no neighbour of it stands.
    fast = action[:, 0] > 1.9 * slowest
    assert fast.sum() > 3
    assert moving[fast] == pytest.approx(action[fast], abs=1e-5)


@pytest.mark.parametrize("goal", ["point", "image", "both"])
@pytest.mark.parametrize(("control_hz", "camera_hz"), [(30, 30), (60, 60), (20, 10)])
def test_policy_decides_whenever_the_robot_is_commanded_with_any_form_of_the_goal(
    tmp_path, goal, control_hz, camera_hz
):
    camera = CameraConfig(height_px=16, width_px=16)
    robot = RobotConfig(control_hz=control_hz, camera_hz=camera_hz, camera=camera)
    export_policy(trained_looking_model(robot, goal=goal, motion="poses"), PolicySpec(robot=robot), tmp_path)
    policy, rng = load_policy(tmp_path), np.random.default_rng(4)
    assert policy.spec.graph.rate_hz is None
    memory, driven, moved = policy.start(), [], np.array([[0.4, 0.9]], np.float32)
    memory.show_goal(rng.integers(0, 256, (16, 16, 3), np.uint8))
    for step in range(24):
        memory.advance(moved[0])
        if step % robot.clock.image_every == 0:
            policy.see([memory], rng.integers(0, 256, (1, 16, 16, 3), np.uint8))
        driven.append(policy.decide([memory], moved, np.array([[3.0, 1.0]], np.float32))[0])
    assert len(np.unique(driven, axis=0)) == 24


def test_equal_weights_give_equal_files(tmp_path):
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    for name, layout in (("a", torch.contiguous_format), ("b", torch.channels_last)):
        model = trained_looking_model(robot).to(memory_format=layout)
        export_policy(model, PolicySpec(robot=robot), tmp_path / name)
    files = ["policy.onnx", "policy.toml", "weights.safetensors"]
    for file in files:
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert sorted(path.name for path in (tmp_path / "a").iterdir()) == files


def test_export_leaves_the_network_as_it_was():
    robot = RobotConfig(camera=CameraConfig(height_px=16, width_px=16))
    model = trained_looking_model(robot).train()
    before = {name: value.clone() for name, value in model.state_dict().items()}
    policy_graph(model, robot, 0.5)
    assert model.training
    assert all(torch.equal(before[name], value) for name, value in model.state_dict().items())


def test_policy_that_is_half_replaced_is_not_loaded(tmp_path, monkeypatch):
    robot = RobotConfig(camera=CameraConfig(height_px=8, width_px=8))
    spec = PolicySpec(robot=robot)
    export_policy(trained_looking_model(robot), spec, tmp_path)
    monkeypatch.setattr("readygo.services.trainer.export.WEIGHTS_FILE", "policy.onnx/weights.safetensors")
    with pytest.raises(PolicyError, match="cannot be written"):
        export_policy(PolicyNet(robot, NetworkConfig()), spec, tmp_path)
    with pytest.raises(PolicyError, match=r"holds no policy\.toml"):
        load_policy(tmp_path)
