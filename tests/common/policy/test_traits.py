import numpy as np
import pytest

from readygo.common.policy.traits import LIMITS_AT, TRAITS, trait_units, traits_of
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.common.robot.ranges import RobotRanges


def test_traits_are_in_si_units_in_the_order_of_their_names() -> None:
    camera = CameraConfig(mount_height_m=0.4, horizontal_fov_deg=90.0, mount_pitch_deg=10.0)
    found = traits_of(RobotConfig(radius_m=0.2, v_max_mps=0.7, w_max_radps=1.1, camera=camera))
    assert found.tolist() == pytest.approx([0.4, 1.0, np.radians(10.0), 0.2, 0.7, 1.1])
    assert TRAITS[LIMITS_AT:] == ("v_max_mps", "w_max_radps")


def test_units_bring_the_ends_of_ranges_to_one_and_leave_out_what_does_not_differ() -> None:
    robot = RobotConfig(ranges=RobotRanges(v_max_mps=(0.4, 0.8), horizontal_fov_deg=(80.0, 120.0)))
    factor, offset = trait_units(robot)
    ends = [{"v_max_mps": v, "horizontal_fov_deg": fov} for v, fov in ((0.4, 80.0), (0.8, 120.0))]
    low, high = (traits_of(robot.with_values(values)) * factor + offset for values in ends)
    assert low.tolist() == pytest.approx([0, -1, 0, 0, -1, 0])
    assert high.tolist() == pytest.approx([0, 1, 0, 0, 1, 0])
