import dataclasses
import subprocess
import sys

import pytest

from readygo.common.camera import SensorConfig
from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, check_policy_camera, check_policy_limits
from readygo.common.robot import CameraConfig, RobotConfig
from tests.common.policy.artifacts import CAMERA, ROBOT


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


def test_importing_the_package_loads_neither_torch_nor_onnxruntime():
    code = "import sys, readygo.common.policy; assert not {'torch', 'onnxruntime', 'onnx', 'cv2'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
