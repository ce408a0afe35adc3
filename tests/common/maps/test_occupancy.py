import dataclasses

import numpy as np
import pytest

from readygo.common.gaussians import concatenate, load_gaussians, transform_cloud
from readygo.common.maps import MapConfig, largest_free_area, plan_scene
from tests.common.maps.crooked import crooked_scene
from tests.common.maps.room import box, room, sheet

CONFIG = MapConfig()


def state(occupancy, x_m, y_m):
    return bool(occupancy.occupied[occupancy.frame.cell(x_m, y_m)])


def test_room_is_free_inside_and_blocked_at_walls_and_outside():
    plan = plan_scene(room(), CONFIG)
    for occupancy in (plan.robot, plan.human):
        assert not state(occupancy, 3, 2.5)
        assert state(occupancy, 0.0, 2.5)
        assert state(occupancy, -0.3, 2.5)
    _, area_m2 = largest_free_area(plan.robot, 0.3)
    assert area_m2 == pytest.approx(5.3 * 4.3, rel=0.04)
    assert plan.unknown[plan.robot.frame.cell(-0.3, 2.5)]
    assert not plan.unknown[plan.robot.frame.cell(3, 2.5)]


def test_table_blocks_humans_but_not_a_low_robot():
    plan = plan_scene(concatenate([room(), box((2, 2, 0.72), (3.6, 3, 0.76))]), CONFIG)
    assert state(plan.human, 2.8, 2.5)
    assert not state(plan.robot, 2.8, 2.5)


def two_levels(parts, height_m):
    """A low floor from x = -2 to 2 m, parts that lead up, and a floor at `height_m` from x = 4 to 6 m."""
    return concatenate([sheet((-2, 0, 0), (4, 0, 0), (0, 5, 0)), *parts, sheet((4, 0, height_m), (2, 0, 0), (0, 5, 0))])


def stairs(rise_m, count):
    """Steps of equal depth from x = 2 to 4 m."""
    depth_m = 2 / count
    for k in range(count):
        yield sheet((2 + k * depth_m, 0, k * rise_m), (0, 5, 0), (0, 0, rise_m), spacing_m=0.04)
        yield sheet((2 + k * depth_m, 0, (k + 1) * rise_m), (depth_m, 0, 0), (0, 5, 0))


@pytest.mark.parametrize(
    ("cloud", "passable"),
    [
        (two_levels([sheet((2, 0, 0), (2, 0, 0.6), (0, 5, 0))], 0.6), True),
        (two_levels([sheet((2, 0, 0), (2, 0, 1.0), (0, 5, 0))], 1.0), False),
        (two_levels(stairs(0.05, 1), 0.05), True),
        (two_levels(stairs(0.2, 1), 0.2), False),
        (two_levels(stairs(0.15, 6), 0.9), False),
    ],
    ids=["ramp of 30 %", "ramp of 50 %", "sill", "step", "stairs"],
)
def test_ramps_and_sills_are_passable_but_steep_ramps_steps_and_stairs_are_not(cloud, passable):
    plan = plan_scene(cloud, CONFIG)
    reached, _ = largest_free_area(plan.robot, 0.3)
    assert reached[plan.robot.frame.cell(1.0, 2.5)]
    i, j = plan.robot.frame.cell(5.0, 2.5)
    assert (j < reached.shape[1] and bool(reached[i, j])) == passable


@pytest.mark.parametrize("slope_max", [0.25, 0.35])
@pytest.mark.parametrize("R", [np.eye(3), [[0, -1, 0], [1, 0, 0], [0, 0, 1]]], ids=["along x", "along y"])
def test_ramp_of_30_percent_is_blocked_where_less_is_allowed(R, slope_max, monkeypatch):
    monkeypatch.setattr("readygo.common.maps.occupancy.SLOPE_MAX", slope_max)
    cloud = transform_cloud(two_levels([sheet((2, 0, 0), (2, 0, 0.6), (0, 5, 0))], 0.6), R)
    plan = plan_scene(cloud, CONFIG)
    below, ramp = (np.asarray(R) @ (x, 2.5, 0.0) for x in (1.0, 3.0))
    assert not state(plan.robot, *below[:2])
    assert state(plan.robot, *ramp[:2]) is (slope_max < 0.3)


def test_box_on_a_tilted_floor_blocks_and_the_tilt_does_not():
    tilt = 0.1
    cloud = concatenate([room(tilt=tilt), box((4, 2, 4 * tilt), (4.5, 2.5, 4 * tilt + 0.4))])
    plan = plan_scene(cloud, CONFIG)
    assert state(plan.robot, 4.25, 2.05)
    assert not state(plan.robot, 1.0, 1.0)
    assert not state(plan.robot, 5.5, 4.0)


def test_things_below_the_ground_clearance_are_floor():
    plan = plan_scene(concatenate([room(), box((2, 2, 0), (3, 3, 0.06))]), CONFIG)
    assert not state(plan.robot, 2.5, 2.5)


def test_haze_and_single_specks_over_the_floor_do_not_close_it():
    haze = sheet((1, 1, 0.3), (1, 0, 0), (0, 1, 0), opacity=0.15)
    speck = sheet((4.01, 4.01, 0.13), (0.03, 0, 0), (0, 0.03, 0), spacing_m=0.03)
    plan = plan_scene(concatenate([room(), haze, speck]), CONFIG)
    assert not state(plan.robot, 1.5, 1.5)
    assert not state(plan.robot, 4.02, 4.02)


def test_haze_is_no_obstacle_however_dense_and_counts_from_its_least_opacity_on():
    for opacity, blocks in ((0.19, False), (0.21, True)):
        haze = sheet((1, 1, 0.3), (1, 0, 0), (0, 1, 0), opacity=opacity, spacing_m=0.02)
        assert state(plan_scene(concatenate([room(), haze]), CONFIG).robot, 1.5, 1.5) is blocks


def test_cells_without_floor_are_unknown_unless_something_stands_there():
    # Off the ground: its underside is no floor.
    beside = box((-0.45, 2.3, 0.3), (-0.3, 2.7, 0.6))
    for cloud, unknown in ((room(), True), (concatenate([room(), beside]), False)):
        plan = plan_scene(cloud, CONFIG)
        assert plan.unknown[plan.robot.frame.cell(-0.38, 1.0)]
        assert bool(plan.unknown[plan.robot.frame.cell(-0.38, 2.5)]) is unknown
        assert plan.robot.occupied[plan.unknown].all()


def test_low_but_wide_obstacle_blocks():
    plan = plan_scene(concatenate([room(), box((2, 2, 0), (2.5, 2.5, 0.17))]), CONFIG)
    assert state(plan.robot, 2.25, 2.25)


def test_thin_pole_blocks():
    plan = plan_scene(concatenate([room(), box((3, 3, 0), (3.04, 3.04, 1.5))]), CONFIG)
    assert state(plan.robot, 3.02, 3.02)


def test_handrail_over_invisible_glass_blocks_the_robot():
    rail = box((0.1, 2.4, 1.0), (5.9, 2.5, 1.06))
    plan = plan_scene(concatenate([room(), rail]), CONFIG)
    assert state(plan.robot, 3.0, 2.45)
    _, open_m2 = largest_free_area(plan_scene(room(), CONFIG).robot, 0.3)
    _, closed_m2 = largest_free_area(plan.robot, 0.3)
    assert closed_m2 < 0.6 * open_m2


def test_maps_do_not_depend_on_the_number_of_row_bands(monkeypatch):
    cloud = concatenate([room(), box((2, 2, 0), (3, 3, 1.2))])
    whole = plan_scene(cloud, CONFIG)
    monkeypatch.setattr("readygo.common.maps.voxels.VOXELS_PER_BAND", 30_000)
    banded = plan_scene(cloud, CONFIG)
    np.testing.assert_array_equal(whole.robot.occupied, banded.robot.occupied)
    np.testing.assert_array_equal(whole.human.occupied, banded.human.occupied)


@pytest.mark.parametrize(
    "wrong", [{"resolution_m": 0.0}, {"opacity_threshold": 0.0}, {"robot_height_m": 0.05}, {"human_height_m": 0.1}]
)
def test_config_refuses_values_without_meaning(wrong):
    with pytest.raises(ValueError, match="must be"):
        MapConfig(**wrong)


def test_real_flat_has_the_free_area_of_its_rooms(shared_data):
    plan = plan_scene(load_gaussians(shared_data / "scenes" / "showroom.compressed.ply"), CONFIG)
    cells, area_m2 = largest_free_area(plan.robot, 0.3)
    assert 80 <= area_m2 <= 110
    living_room, terrace, bedroom = (1.5, -5.6), (2.5, -0.5), (-5.0, -3.5)
    for x_m, y_m in (living_room, terrace, bedroom):
        row, column = plan.robot.frame.cell(x_m, y_m)
        assert cells[row - 10 : row + 11, column - 10 : column + 11].any()
    beyond_the_glass_railing = plan.robot.frame.cell(2.5, 2.6)
    assert not cells[beyond_the_glass_railing]


def test_thick_gaussians_of_the_floor_are_no_obstacle_but_low_boxes_are():
    thick = sheet((2, 2, 0.02), (0.6, 0, 0), (0, 0.6, 0))
    thick = dataclasses.replace(thick, scales_m=np.full_like(thick.scales_m, 0.18))
    plan = plan_scene(concatenate([room(), thick]), CONFIG)
    assert not state(plan.robot, 2.3, 2.3)
    assert plan.phantoms[plan.robot.frame.cell(2.3, 2.3)]
    for height_m in (0.12, 0.14):
        plan = plan_scene(concatenate([room(), box((2, 2, 0), (2.3, 2.3, height_m))]), CONFIG)
        assert state(plan.robot, 2.15, 2.15)
        assert not plan.phantoms.any()


@pytest.mark.parametrize("number", range(3))
def test_maps_of_a_crooked_scene_are_as_they_were(number, golden_figures):
    config = [MapConfig(), MapConfig(resolution_m=0.07, robot_height_m=1.1), MapConfig(close_coarse=True)][number]
    plan = plan_scene(crooked_scene(), config, np.array([[0.0, 5.0, 1.9], [0.6, 5.6, 1.9]]))
    frame, robot = plan.robot.frame, plan.robot.occupied
    place = [frame.origin_x_m, frame.origin_y_m, frame.resolution_m, *robot.shape]
    golden_figures(f"maps/frame {number}", [place])
    cells = [one.reshape(-1) for one in (robot, plan.human.occupied, plan.unknown, plan.coarse, plan.blurred)]
    golden_figures(f"maps/cells {number}", *cells, np.arange(robot.size) % 89, scale=0.9)
    height_m = plan.floor.height_m.reshape(-1)
    golden_figures(f"maps/floor {number}", 20.0 * height_m, np.arange(len(height_m)) % 89)
    golden_figures(f"maps/ground size {number}", [plan.ground_size_m])
