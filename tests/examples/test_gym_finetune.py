"""The example that fine-tunes a policy does so, for some steps."""

import importlib.util
from pathlib import Path

import pytest
import torch

from readygo.common.config import section_to_mapping
from readygo.common.policy import PolicySpec, load_policy
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import PolicyNet

pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")
pytest.importorskip("stable_baselines3", reason="stable-baselines3 (extra rl) is not installed")

EXAMPLE = Path(__file__).resolve().parents[2] / "examples" / "gym_finetune.py"


@pytest.fixture
def example():
    spec = importlib.util.spec_from_file_location("gym_finetune", EXAMPLE)
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


@pytest.fixture
def policy(tmp_path):
    torch.manual_seed(2)
    robot = RobotConfig(camera=CameraConfig(height_px=24, width_px=32))
    network = NetworkConfig(output="weighed", widths=(4, 4, 4, 4, 4), motion="poses")
    short = {"settings": {"episode": {"time_limit_s": 2.0}}}
    training = {"config": {"network": section_to_mapping(network)}, "data": short}
    export_policy(PolicyNet(robot, network).eval(), PolicySpec(robot=robot, training=training), tmp_path / "policy")
    return tmp_path / "policy"


def test_head_is_trained_and_the_rates_are_told(example, policy, tmp_path, capsys, monkeypatch):
    # The critic would learn alone for longer than this test lasts.
    monkeypatch.setattr(example, "CRITIC_ROLLOUTS", 0)
    arguments = ["--minutes", "0.03", "--episodes", "1", "--robots", "2", "--humans", "1", "--rollout-steps", "8"]
    example.main([str(policy), "--out", str(tmp_path / "tuned"), *arguments])
    told = capsys.readouterr().out
    assert "dynamic  before  success" in told
    assert "dynamic  after   success" in told
    tuned = load_policy(tmp_path / "tuned")
    assert tuned.spec.training["fine_tuned"]["steps"] >= 16
    assert (tmp_path / "tuned" / "policy.onnx").read_bytes() != (policy / "policy.onnx").read_bytes()


def test_policy_that_is_missing_is_one_line(example, tmp_path):
    with pytest.raises(SystemExit, match=r"policy\.toml"):
        example.main([str(tmp_path)])
