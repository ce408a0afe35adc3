from pathlib import Path

import pytest

from readygo.apps.commands.train import closed_loop
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.policy import PolicySpec
from readygo.common.robot import RobotConfig


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
