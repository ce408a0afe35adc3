from pathlib import Path

import pytest
import torch

from experiments.policy.robots import compare
from readygo.common.errors import RunError
from readygo.common.policy import PolicySpec
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.services.trainer.config import NetworkConfig
from readygo.services.trainer.export import export_policy
from readygo.services.trainer.model import PolicyNet

CAMERA = CameraConfig(height_px=24, width_px=32)


def policy(folder: Path, robot: RobotConfig) -> Path:
    torch.manual_seed(0)
    export_policy(PolicyNet(robot, NetworkConfig()).eval(), PolicySpec(robot=robot), folder)
    return folder


def test_policies_drive_the_same_robot_whether_they_know_it_or_not(tmp_path: Path) -> None:
    several = RobotConfig(camera=CAMERA, ranges=RobotRanges(v_max_mps=(0.5, 1.2), mount_height_m=(0.2, 0.8)))
    robot = RobotConfig(v_max_mps=0.6, camera=CameraConfig(height_px=24, width_px=32, mount_height_m=0.3))
    policies = {
        "several": policy(tmp_path / "several", several),
        "one": policy(tmp_path / "one", RobotConfig(camera=CAMERA)),
    }
    found = compare("embedded", robot, policies, episodes=1, seed=0, out=tmp_path / "out")
    assert set(found["measures"]["static"]) == {"several", "one", "expert", "straight-line"}
    assert found["measures"]["static"]["one"]["success"]["count"] == 1
    kept = compare("embedded", robot, {"several": policies["several"]}, episodes=1, seed=0, out=tmp_path / "out")
    assert kept["measures"]["static"]["several"] == found["measures"]["static"]["several"]
    with pytest.raises(RunError, match="v_max_mps"):
        compare("embedded", RobotConfig(camera=CAMERA), policies, episodes=1, seed=0, out=tmp_path / "out")
