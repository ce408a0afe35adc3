import numpy as np
import pytest

from readygo.common.gaussians import concatenate
from readygo.common.maps import FloorMap, GridFrame, MapConfig, plan_scene
from readygo.common.maps.coarse_ground import ground_detail
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


def test_rug_of_one_large_cell_is_no_border_of_ground_that_nobody_filmed():
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.5)
    floor = FloorMap(frame=frame, height_m=np.zeros((12, 24), np.float32))
    filmed = sheet((0, 0, 0), (6, 0, 0), (0, 6, 0))
    guessed = sheet((6, 0, 0), (6, 0, 0), (0, 6, 0), spacing_m=0.5)
    under = (np.abs(guessed.means_m[:, :2] - (9.25, 3.25)) < 0.25).all(axis=1)
    rug = sheet((9.0, 3.0, 0), (0.5, 0, 0), (0, 0.5, 0))
    cloud = concatenate([filmed, guessed.select(~under), rug])
    coarse = ground_detail(cloud, floor, np.ones((12, 24), np.bool_)).coarse
    assert coarse[:, 13:].all()
    assert not coarse[:, :11].any()
