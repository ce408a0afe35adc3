"""The whole embedded scene: its Gaussians and what its maps say of it."""

import numpy as np
from scipy import ndimage

from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.maps import OccupancyMap
from readygo.common.maps.distance import clearance_m
from readygo.common.maps.occupancy import MapConfig, plan_scene
from readygo.common.scenes import Scene
from readygo.common.scenes.embedded.drawn_plan import draw_plan
from readygo.common.scenes.embedded.plan import FLAT, Room
from readygo.common.scenes.embedded.scene import drawn_scene_cloud, embedded_scene_cloud, embedded_sky, floor_height_m

ARRAYS = ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")


def display(cloud: GaussianCloud) -> np.ndarray:
    return 0.5 + SH_C0 * cloud.sh[:, 0]


def test_same_seed_gives_the_same_gaussians_and_another_seed_others(cloud: GaussianCloud) -> None:
    again, other = embedded_scene_cloud(0), embedded_scene_cloud(1)
    assert all(np.array_equal(getattr(cloud, name), getattr(again, name)) for name in ARRAYS)
    assert len(other) != len(cloud) or not np.array_equal(other.sh, cloud.sh)


def test_gaussians_are_valid_flat_and_few(cloud: GaussianCloud) -> None:
    assert 30_000 <= len(cloud) <= 82_000
    assert all(np.isfinite(getattr(cloud, name)).all() for name in ARRAYS)
    np.testing.assert_allclose(np.linalg.norm(cloud.quats_wxyz, axis=1), 1.0, atol=3e-5)
    assert (cloud.scales_m > 0).all()
    assert np.median(cloud.scales_m.min(axis=1)) < 0.006
    colour = display(cloud)
    assert colour.min() > -0.01
    assert colour.max() < 1.01
    assert colour.std() > 0.15


def test_colours_are_rounded_so_that_last_bits_cannot_matter(cloud: GaussianCloud) -> None:
    scaled = cloud.means_m.astype(np.float64) * 1e5
    assert np.abs(scaled - np.rint(scaled)).max() < 0.05


def test_sky_surrounds_the_flat_and_stays_out_of_it() -> None:
    sky = embedded_sky()
    x, y, z = sky.means_m.T
    assert not ((np.abs(x) < 5.3) & (np.abs(y) < 4.9) & (z > -0.2) & (z < 3.0)).any()
    turn = np.arctan2(sky.means_m[:, 1], sky.means_m[:, 0])
    far = np.hypot(sky.means_m[:, 0], sky.means_m[:, 1]) > 40
    assert (np.histogram(turn[far], bins=24, range=(-np.pi, np.pi))[0] > 10).all()


def reachable(robot: OccupancyMap) -> np.ndarray:
    """The largest connected area of a robot of 0.3 m, as cells of its map."""
    labels, count = ndimage.label(clearance_m(robot) > 0.3)
    return labels == 1 + int(np.argmax(ndimage.sum(labels > 0, labels, range(1, count + 1))))


def room_m2(cells: np.ndarray, robot: OccupancyMap, room: Room) -> float:
    """Area of the cells in a room [m2]."""
    low, high = (robot.frame.cell(x, y) for x, y in zip(room.x_m, room.y_m, strict=True))
    return float(cells[low[0] : high[0], low[1] : high[1]].sum()) * robot.frame.resolution_m**2


def test_robot_reaches_every_room_on_at_least_35_m2(made: Scene) -> None:
    robot = made.maps.robot
    largest = reachable(robot)
    assert largest.sum() * robot.frame.resolution_m**2 >= 35.0
    for room in FLAT.rooms:
        assert room_m2(largest, robot, room) > 3.0, room.name


def test_nothing_outside_of_the_walls_is_free(made: Scene) -> None:
    human = made.maps.human
    rows, columns = np.nonzero(~human.occupied)
    x = human.frame.origin_x_m + (columns + 0.5) * human.frame.resolution_m
    y = human.frame.origin_y_m + (rows + 0.5) * human.frame.resolution_m
    assert np.abs(x).max() < 5.5
    assert np.abs(y).max() < 5.1


def test_straight_lines_between_rooms_are_often_blocked(made: Scene) -> None:
    robot, rng = made.maps.robot, np.random.default_rng(0)
    clearance = clearance_m(robot)
    rows, columns = np.nonzero(clearance > 0.3)
    blocked = tried = 0
    while tried < 200:
        i, j = rng.integers(len(rows), size=2)
        distance = np.hypot(rows[i] - rows[j], columns[i] - columns[j]) * robot.frame.resolution_m
        if not 3 <= distance <= 10:
            continue
        t = np.linspace(0, 1, 250)
        way = clearance[
            np.rint(rows[i] + t * (rows[j] - rows[i])).astype(int),
            np.rint(columns[i] + t * (columns[j] - columns[i])).astype(int),
        ]
        blocked, tried = blocked + int((way < 0.25).any()), tried + 1
    assert 0.5 < blocked / tried < 1.0


def test_floor_is_uneven_by_millimetres(made: Scene) -> None:
    frame = made.maps.robot.frame
    cells = np.argwhere(~made.maps.robot.occupied)
    height = made.maps.floor.at_many(np.array([frame.centre_m(int(i), int(j)) for i, j in cells]))
    assert 0.003 < np.quantile(height, 0.99) - np.quantile(height, 0.01) < 0.04
    assert abs(np.median(height)) < 0.015


def test_maps_follow_the_height_of_the_agent(cloud: GaussianCloud) -> None:
    plan = plan_scene(cloud, MapConfig())
    under_table = plan.robot.frame.cell(2.9, 1.95)
    assert plan.human.occupied[under_table]
    assert not plan.robot.occupied[under_table]


def test_floor_tilts_by_a_millimetre_per_metre_and_bumps_by_less_than_half_a_centimetre() -> None:
    rng = np.random.default_rng(0)
    x, y = rng.uniform(-5, 5, (2, 2000))
    slope, *_ = np.linalg.lstsq(np.stack([x, y, np.ones_like(x)], axis=1), floor_height_m(x, y), rcond=None)
    np.testing.assert_allclose(slope[:2], (0.0010, -0.0006), atol=2e-4)
    assert np.abs(floor_height_m(x, y) - 0.0010 * x + 0.0006 * y).max() <= 0.003


def cloud_rows(cloud: GaussianCloud) -> tuple[np.ndarray, ...]:
    return cloud.means_m, cloud.quats_wxyz, 30.0 * cloud.scales_m, cloud.opacities, 3.0 * cloud.sh


def test_flat_and_its_sky_are_as_they_were(cloud: GaussianCloud, golden_figures) -> None:
    golden_figures("embedded/flat", *cloud_rows(cloud))
    golden_figures("embedded/sky", *cloud_rows(embedded_sky()))


def test_drawn_flat_is_valid_whole_and_as_it_was(golden_figures) -> None:
    drawn = drawn_scene_cloud(2)
    assert all(np.isfinite(getattr(drawn, name)).all() for name in ARRAYS)
    assert 30_000 <= len(drawn) <= 82_000
    assert display(drawn).min() > -0.01
    assert display(drawn).max() < 1.01
    robot, plan = plan_scene(drawn, MapConfig()).robot, draw_plan(np.random.Generator(np.random.PCG64([2, *b"plan"])))
    largest = reachable(robot)
    assert largest.sum() * robot.frame.resolution_m**2 > 20.0
    assert len(plan.rooms) >= 4
    for room in plan.rooms:
        assert room_m2(largest, robot, room) > 0.5, room.name
    golden_figures("embedded/flat plan 2", drawn.means_m, drawn.quats_wxyz, 30.0 * drawn.scales_m, 3.0 * drawn.sh)
