"""The embedded scene: its Gaussians, its maps, its bundle."""

import shutil
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from readygo.common.errors import SceneError
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0
from readygo.common.maps.distance import clearance_m
from readygo.common.maps.occupancy import MapConfig, plan_scene
from readygo.common.scenes import Scene, load_scene
from readygo.common.scenes.embedded import bundle, embedded_scene_cloud, embedded_sky, ensure_embedded_scene
from readygo.common.scenes.embedded.lighting import Lights, lit_colours, voxelise
from readygo.common.scenes.embedded.plan import OPENINGS, ROOMS
from readygo.common.scenes.embedded.surfaces import Surfaces

ARRAYS = ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")


@pytest.fixture(scope="module")
def cloud() -> GaussianCloud:
    return embedded_scene_cloud()


@pytest.fixture(scope="module")
def made(cloud: GaussianCloud, tmp_path_factory: pytest.TempPathFactory) -> Scene:
    patch = pytest.MonkeyPatch()
    patch.setattr(bundle, "embedded_scene_cloud", lambda: cloud)
    scene = ensure_embedded_scene(tmp_path_factory.mktemp("scenes") / "embedded")
    patch.undo()
    return scene


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


def test_robot_reaches_every_room_on_at_least_35_m2(made: Scene) -> None:
    robot = made.maps.robot
    clear = clearance_m(robot) > 0.3
    labels, count = ndimage.label(clear)
    sizes = ndimage.sum(clear, labels, range(1, count + 1)) * robot.frame.resolution_m**2
    assert sizes.max() >= 35.0
    largest = labels == 1 + int(np.argmax(sizes))
    for room in ROOMS:
        low, high = (robot.frame.cell(x, y) for x, y in zip(room.x_m, room.y_m, strict=True))
        part = largest[low[0] : high[0], low[1] : high[1]]
        assert part.sum() * robot.frame.resolution_m**2 > 3.0, room.name


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


def test_doorways_are_at_least_one_metre_wide() -> None:
    assert min(o.end_m - o.begin_m for o in OPENINGS if not o.is_window) >= 1.0
    assert all(o.top_m >= 2.0 for o in OPENINGS if not o.is_window)


def test_floor_is_uneven_by_millimetres(made: Scene) -> None:
    frame = made.maps.robot.frame
    cells = np.argwhere(~made.maps.robot.occupied)
    height = made.maps.floor.at_many(np.array([frame.centre_m(int(i), int(j)) for i, j in cells]))
    assert 0.003 < np.quantile(height, 0.99) - np.quantile(height, 0.01) < 0.04
    assert abs(np.median(height)) < 0.015


def test_bundle_is_made_once_and_then_loaded(made: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(bundle, "embedded_scene_cloud", lambda: pytest.fail("made again"))
    again = ensure_embedded_scene(made.path)
    assert again.content_hash == made.content_hash
    assert again.name == "embedded"
    assert [path.name for path in made.path.parent.iterdir()] == ["embedded"]


def test_bundle_of_another_recipe_is_replaced(
    made: Scene, cloud: GaussianCloud, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    shutil.copytree(made.path, tmp_path / "scene")
    monkeypatch.setattr(bundle, "recipe_hash", lambda: "another")
    monkeypatch.setattr(bundle, "embedded_scene_cloud", lambda: cloud)
    scene = ensure_embedded_scene(tmp_path / "scene")
    assert scene.metadata["source"]["sha256"] == "another"
    assert load_scene(tmp_path / "scene").content_hash == made.content_hash
    assert [path.name for path in tmp_path.iterdir()] == ["scene"]


def test_foreign_folder_is_refused_and_kept(tmp_path: Path) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    with pytest.raises(SceneError, match="something else"):
        ensure_embedded_scene(tmp_path)
    assert (tmp_path / "notes.txt").read_text() == "mine"


def test_surface_behind_a_wall_stays_darker_than_one_before_it() -> None:
    build = Surfaces(np.random.default_rng(0))
    build.solid((-1.0, 0.45, 0.0), (1.0, 0.55, 2.0))
    for y in (0.2, 0.8):
        build.patch((-0.1, y - 0.1, 0.0), (0.2, 0, 0), (0, 0.2, 0), 0.2, (0.5, 0.5, 0.5))
    samples = build.samples()
    grid = voxelise(build.solid_points_m(), np.array([-1.0, -1.0, -0.05]), np.array([1.0, 2.0, 2.05]))
    lights = Lights(
        position_m=np.array([[0.0, -0.5, 1.0]]),
        direction=np.zeros((1, 3)),
        power=np.ones((1, 3)),
        sun_direction=np.array([0.0, 0.0, -1.0]),
        sun_power=np.zeros(3),
    )
    before, behind = lit_colours(samples, grid, lights)[:, 0]
    assert before > 2 * behind


def test_cleared_samples_are_those_added_before() -> None:
    build = Surfaces(np.random.default_rng(0))
    build.patch((0, 0, 0), (1.0, 0, 0), (0, 1.0, 0), 0.1, (0.5, 0.5, 0.5))
    moved = build.at(0.5, 0.5, yaw_deg=90)
    moved.clear((-0.21, -0.21, -0.01), (0.21, 0.21, 0.01))
    moved.patch((-0.05, -0.05, 0), (0.1, 0, 0), (0, 0.1, 0), 0.1, (1.0, 0.0, 0.0))
    position = build.samples().position_m
    assert len(position) == 100 - 16 + 1
    np.testing.assert_allclose(position[-1], [0.5, 0.5, 0.0], atol=1e-12)


def test_maps_follow_the_height_of_the_agent(cloud: GaussianCloud) -> None:
    plan = plan_scene(cloud, MapConfig())
    under_table = plan.robot.frame.cell(2.9, 1.95)
    assert plan.human.occupied[under_table]
    assert not plan.robot.occupied[under_table]
