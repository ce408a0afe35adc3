import io
import math
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest
from rich.console import Console

from readygo.apps.commands.train import _progress, closed_loop, run_training
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec
from readygo.common.robot import RobotConfig
from readygo.services.trainer import TrainConfig


def test_losses_are_shown_once_they_are_known() -> None:
    console = Console(file=io.StringIO(), width=200, force_terminal=True, color_system=None)
    with _progress(console, quiet=False) as show:
        show(SimpleNamespace(fraction=0.1, step=0, train_loss=math.nan, validation_loss=math.nan))
        show(SimpleNamespace(fraction=0.5, step=7, train_loss=0.25, validation_loss=math.nan))
    shown = console.file.getvalue()
    assert "step 7, loss 0.2500, ETA" in shown
    assert "nan" not in shown


def test_missing_torch_is_one_line_with_the_command_that_installs_it(tmp_path, monkeypatch) -> None:
    monkeypatch.setitem(sys.modules, "readygo.services.trainer.train", None)
    with pytest.raises(PolicyError, match=r"^Training needs .*; run: .*pip install -e .*\[train\]"):
        run_training((tmp_path,), TrainConfig(), tmp_path / "policy")


class ReachedError(Exception):
    pass


def test_checkpoints_are_measured_with_the_camera_of_the_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = RobotConfig(camera=CameraConfig(distortion="fisheye", mount_pitch_deg=5.0))
    spec = PolicySpec(robot=robot, sensor=SensorConfig(vignetting=(0.0, 0.2)))
    configs = []

    def make_evaluator(scene, config, **settings) -> None:
        configs.append(config)
        raise ReachedError

    monkeypatch.setattr("readygo.apps.commands.evaluate.make_evaluator", make_evaluator)
    monkeypatch.setattr("readygo.common.policy.load_policy", lambda folder: type("Policy", (), {"spec": spec}))
    with pytest.raises(ReachedError):
        closed_loop("embedded", episodes=1, seed=0)(Path("policy"))
    assert configs[0].robot == robot
    assert configs[0].renderer.sensor == spec.sensor
