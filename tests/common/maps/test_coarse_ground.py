import numpy as np
import pytest

from readygo.common.gaussians import concatenate
from readygo.common.maps import MapConfig, plan_scene
from tests.common.maps.room import sheet


def test_ground_of_huge_gaussians_is_found_and_closed_on_demand():
    filmed = sheet((0, 0, 0), (6, 0, 0), (0, 6, 0))
    guessed = sheet((6, 0, 0), (6, 0, 0), (0, 6, 0), spacing_m=0.8)
    cloud = concatenate([filmed, guessed])
    plan = plan_scene(cloud, MapConfig())
    frame = plan.robot.frame
    assert plan.coarse[frame.cell(9.0, 3.0)]
    assert not plan.coarse[frame.cell(3.0, 3.0)]
    assert plan.blurred[frame.cell(9.0, 3.0)]
    assert not plan.blurred[frame.cell(3.0, 3.0)]
    assert plan.ground_size_m == pytest.approx(0.042, rel=0.01)
    assert not plan.robot.occupied[frame.cell(9.0, 3.0)]
    closed = plan_scene(cloud, MapConfig(close_coarse=True))
    np.testing.assert_array_equal(closed.robot.occupied, plan.robot.occupied | plan.coarse)
    assert closed.unknown[frame.cell(9.0, 3.0)]
