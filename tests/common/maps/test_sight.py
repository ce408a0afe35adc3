import numpy as np
import pytest

from readygo.common.gaussians import concatenate
from readygo.common.maps import GridFrame, MapConfig, OccupancyMap, plan_scene, sight_of_cloud, sight_of_occupancy
from tests.common.maps.room import box, room

CAMERA_M = 0.5


@pytest.fixture(scope="module")
def furnished():
    """A room with a table of 0.75 m, a wall, and a shelf that hangs over the floor."""
    table = box((1.8, 0.5, 0.0), (2.4, 1.5, 0.75))
    wall = box((1.8, 2.0, 0.0), (2.0, 3.0, 2.4))
    shelf = box((1.8, 3.6, 1.0), (2.2, 4.6, 2.0))
    cloud = concatenate([room(), table, wall, shelf])
    config = MapConfig()
    plan = plan_scene(cloud, config)
    shape = plan.robot.occupied.shape
    return plan, sight_of_cloud(cloud, plan.floor, plan.robot.frame, shape, config)


@pytest.mark.parametrize(("y_m", "seen"), [(1.0, True), (2.5, False), (4.1, True)])
def test_walls_hide_a_human_and_tables_and_shelves_do_not(furnished, y_m, seen):
    plan, sight = furnished
    cell = plan.robot.frame.cell(1.82, y_m)
    assert plan.human.occupied[cell]
    assert sight.sees(0.8, y_m, CAMERA_M, (4.0, y_m)) is seen


def test_part_of_the_body_beside_a_wall_is_enough(furnished):
    _, sight = furnished
    assert sight.sees(0.8, 3.5, CAMERA_M, (4.0, 3.05))
    assert not sight.sees(0.8, 2.5, CAMERA_M, (4.0, 2.5))


def test_occupied_cells_of_a_bare_map_hide_everything():
    occupied = np.zeros((40, 40), np.bool_)
    occupied[10:30, 20] = True
    frame = GridFrame(origin_x_m=-1.0, origin_y_m=-1.0, resolution_m=0.05)
    sight = sight_of_occupancy(OccupancyMap(frame=frame, occupied=occupied))
    assert not sight.sees(-0.8, 0.0, CAMERA_M, (0.6, 0.0))
    assert sight.sees(-0.8, 0.8, CAMERA_M, (0.6, 0.8))


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_shoulder_beside_a_wall_shows_a_human_whose_middle_is_hidden(side):
    occupied = np.zeros((40, 40), np.bool_)
    occupied[10:30, 20] = True
    frame = GridFrame(origin_x_m=-1.0, origin_y_m=-1.0, resolution_m=0.05)
    sight = sight_of_occupancy(OccupancyMap(frame=frame, occupied=occupied))
    # The wall ends 0.5 m beside the axis: the line to the middle of the first human passes it at 0.45 m.
    assert sight.sees(-0.8, 0.0, CAMERA_M, (0.6, 0.78 * side))
    assert not sight.sees(-0.8, 0.0, CAMERA_M, (0.6, 0.55 * side))


def test_finer_cells_share_bits_and_see_the_same():
    cloud = concatenate([room(3.0, 2.0), box((1.4, 0.0, 0.0), (1.5, 1.0, 2.4))])
    config = MapConfig(resolution_m=0.025)
    plan = plan_scene(cloud, config)
    sight = sight_of_cloud(cloud, plan.floor, plan.robot.frame, plan.robot.occupied.shape, config)
    assert sight.layer_m == pytest.approx(0.05)
    assert not sight.sees(0.5, 0.5, CAMERA_M, (2.5, 0.5))
    assert sight.sees(0.5, 1.6, CAMERA_M, (2.5, 1.6))
