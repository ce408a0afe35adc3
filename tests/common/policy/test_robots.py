import dataclasses

import pytest

from readygo.common.errors import PolicyError
from readygo.common.policy import PolicySpec, check_policy_camera, check_policy_limits
from readygo.common.policy.robots import RANGED, known_as
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.robot.ranges import RobotRanges

TRAINED = RobotConfig(ranges=RobotRanges(mount_height_m=(0.2, 0.8), radius_m=(0.2, 0.3), v_max_mps=(0.5, 1.2)))
SPEC = PolicySpec(robot=TRAINED)
LOW = RobotConfig(radius_m=0.22, planning_radius_m=0.3, v_max_mps=0.6, camera=CameraConfig(mount_height_m=0.3))


def test_robot_within_the_ranges_is_known() -> None:
    assert known_as(TRAINED, LOW, RANGED) == LOW
    check_policy_camera(SPEC, LOW)
    check_policy_limits(SPEC, LOW)
    narrower = dataclasses.replace(LOW, ranges=RobotRanges(v_max_mps=(0.6, 0.9)))
    check_policy_limits(SPEC, narrower)


def test_robot_outside_of_a_range_is_refused_with_the_range() -> None:
    tall = dataclasses.replace(LOW, camera=CameraConfig(mount_height_m=1.1))
    with pytest.raises(
        PolicyError, match=r"other ranges: mount_height_m 1\.1 \(the policy's: 0\.2 to 0\.8\)\."
    ) as caught:
        check_policy_camera(SPEC, tall)
    assert "\n" not in str(caught.value)
    with pytest.raises(PolicyError, match=r"v_max_mps 0\.6 to 1\.5 \(the policy's: 0\.5 to 1\.2\)"):
        check_policy_limits(SPEC, dataclasses.replace(LOW, ranges=RobotRanges(v_max_mps=(0.6, 1.5))))


def test_what_has_no_range_is_compared_as_before() -> None:
    with pytest.raises(PolicyError, match=r"another camera: mount_pitch_deg 0 \(the robot's: 5\)"):
        check_policy_camera(
            SPEC, dataclasses.replace(LOW, camera=CameraConfig(mount_height_m=0.3, mount_pitch_deg=5.0))
        )
    with pytest.raises(PolicyError, match=r"other limits or rates: w_max_radps 1\.2 \(the robot's: 2\)"):
        check_policy_limits(SPEC, dataclasses.replace(LOW, w_max_radps=2.0))


def test_robot_reverses_as_the_same_share_of_its_speed() -> None:
    spec = PolicySpec(robot=dataclasses.replace(TRAINED, v_min_mps=-0.3))
    check_policy_limits(spec, dataclasses.replace(LOW, v_min_mps=-0.18))
    with pytest.raises(PolicyError, match=r"v_min_mps -0\.18 \(the robot's: -0\.1\)"):
        check_policy_limits(spec, dataclasses.replace(LOW, v_min_mps=-0.1))


def test_policy_of_one_robot_does_not_know_several() -> None:
    with pytest.raises(PolicyError, match=r"v_max_mps 0\.5 to 1\.2 \(the policy's: 1\)"):
        check_policy_limits(PolicySpec(robot=RobotConfig()), TRAINED)
