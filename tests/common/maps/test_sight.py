import math

import numpy as np
import pytest

from readygo.common.gaussians import concatenate
from readygo.common.maps import GridFrame, MapConfig, OccupancyMap, plan_scene, sight_of_cloud, sight_of_occupancy
from readygo.common.maps.sight import BITS, BOTTOM_M, TARGET_HEIGHTS_M, SightMap
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


@pytest.mark.parametrize(
    ("low_m", "high_m", "first", "last"),
    [(0.41, 0.44, 0, 0), (0, 0.47, 0, 1), (0.62, 0.97, 3, 9), (2.31, 2.35, 31, 31), (1, 9, 10, 31), (0, 9, 0, 31)],
)  # fmt: skip
def test_band_of_heights_has_the_layers_that_it_reaches_into(low_m, high_m, first, last):
    opaque = np.left_shift(np.uint32(1), np.arange(BITS, dtype=np.uint32)).reshape(4, 8)
    sight = SightMap(frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1), opaque=opaque, layer_m=0.06)
    layers = np.flatnonzero(sight.opaque_between(low_m, high_m))
    assert layers.tolist() == [*range(first, last + 1)]


def test_human_is_seen_where_one_of_nine_rays_meets_no_opaque_layer_each_half_cell():
    """Random boxes on an oblong map off the origin, from cameras of all heights, in all directions."""
    rng = np.random.default_rng(5)
    frame, layer_m = GridFrame(origin_x_m=-2.3, origin_y_m=4.1, resolution_m=0.13), 0.047
    opaque = np.where(rng.random((23, 41)) < 0.15, rng.integers(0, 2**32, (23, 41), dtype=np.uint32), np.uint32(0))
    sight = SightMap(frame=frame, opaque=opaque, layer_m=layer_m)
    seen = []
    for _ in range(120):
        eye = np.array([*rng.uniform((-2.5, 3.9), (3.2, 7.3)), rng.uniform(0.2, 2.2)])
        human = rng.uniform((-2.5, 3.9), (3.2, 7.3))
        ahead = (human - eye[:2]) / np.hypot(*(human - eye[:2]))
        rays = [
            [*(human + offset_m * np.array([-ahead[1], ahead[0]])), height_m]
            for offset_m in (-0.2, 0.0, 0.2)
            for height_m in TARGET_HEIGHTS_M
        ]
        expected = any(_is_clear(opaque, frame, layer_m, eye, np.array(target)) for target in rays)
        assert sight.sees(*eye.tolist(), tuple(human.tolist())) is expected
        seen.append(expected)
    assert 0.2 < np.mean(seen) < 0.8


def _is_clear(opaque, frame, layer_m, eye, target):
    steps = math.floor(math.dist(eye[:2], target[:2]) / (0.5 * frame.resolution_m)) + 1
    for point in eye + (target - eye) * np.linspace(0.0, 1.0, steps + 1)[:, None]:
        j, i = np.floor((point[:2] - (frame.origin_x_m, frame.origin_y_m)) / frame.resolution_m).astype(int).tolist()
        bit = max(math.floor((point[2] - BOTTOM_M) / layer_m), 0)
        inside = 0 <= i < opaque.shape[0] and 0 <= j < opaque.shape[1] and bit < BITS
        if inside and int(opaque[i, j]) >> bit & 1:
            return False
    return True


@pytest.mark.parametrize("camera_m", [0.1, 0.2, 0.3, 0.35, 0.4, 0.5])
@pytest.mark.parametrize("distance_m", [2.0, 3.0, 6.0])
def test_walls_hide_humans_from_low_cameras(camera_m: float, distance_m: float) -> None:
    occupied = np.zeros((100, 100), np.bool_)
    occupied[:, 60:62] = True
    frame = GridFrame(origin_x_m=-5.0, origin_y_m=-5.0, resolution_m=0.1)
    sight = sight_of_occupancy(OccupancyMap(frame=frame, occupied=occupied))
    assert not sight.sees(0.0, 0.0, camera_m, (distance_m, 0.0))
    assert sight.sees(0.0, 0.0, camera_m, (-distance_m + 1.2, 0.0))


def test_maps_sight_does_not_depend_on_the_bands_that_it_is_computed_in(monkeypatch):
    cloud = concatenate([room(2.4, 1.7), box((0.9, 0.3, 0.0), (1.3, 0.8, 0.9)), box((1.5, 0.9, 1.2), (1.9, 1.4, 1.6))])
    plan = plan_scene(cloud, MapConfig())
    shape = plan.robot.occupied.shape
    whole = sight_of_cloud(cloud, plan.floor, plan.robot.frame, shape, MapConfig())
    monkeypatch.setattr("readygo.common.maps.voxels.VOXELS_PER_BAND", 1)
    rows = sight_of_cloud(cloud, plan.floor, plan.robot.frame, shape, MapConfig())
    np.testing.assert_array_equal(rows.opaque, whole.opaque)
    heights_m = BOTTOM_M + whole.layer_m * (np.arange(30) + 0.5)
    for (x_m, y_m), low_m, high_m in (((0.9, 0.55), 0.0, 0.9), ((1.5, 1.15), 1.2, 1.6)):
        i, j = plan.robot.frame.cell(x_m, y_m)
        side = np.bitwise_or.reduce(whole.opaque[i - 1 : i + 2, j - 1 : j + 2], axis=None)
        bits = side >> np.arange(30, dtype=np.uint32) & np.uint32(1) > 0
        assert bits[(low_m + 0.05 < heights_m) & (heights_m < high_m - 0.05)].all()
        assert not bits[(heights_m < low_m - 0.1) | (heights_m > high_m + 0.1)].any()
