from pathlib import Path

import numpy as np
import pytest

from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.irradiance import irradiance
from readygo.common.lighting.probes import LightProbes, load_or_make_probes, make_probes
from readygo.common.maps import FloorMap, GridFrame, OccupancyMap
from readygo.common.rasterizer.packed.scene import PackedScene, pack_cloud

SIDE_M = 6.0
FRAME = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.25)
CELLS = round(SIDE_M / FRAME.resolution_m)
UP, DOWN, EAST, WEST = ([0.0, 0, 1], [0.0, 0, -1], [1.0, 0, 0], [-1.0, 0, 0])


def room(colours: dict[str, float]) -> PackedScene:
    """Opaque walls of Gaussians around a room of 6 m; sides by name with their grey, 0.5 by default."""
    grid = np.stack(np.meshgrid(np.arange(0.0, SIDE_M, 0.15), np.arange(0.0, SIDE_M, 0.15)), -1).reshape(-1, 2)
    flat = {"west": (0, 0.0), "east": (0, SIDE_M), "south": (1, 0.0), "north": (1, SIDE_M), "down": (2, 0.0)}
    means, greys = [], []
    for name, (axis, at) in {**flat, "up": (2, 3.0)}.items():
        points = np.insert(grid, axis, at, axis=1)
        points = points[points[:, 2] <= 3.0]
        means.append(points)
        greys.append(np.full(len(points), colours.get(name, 0.5)))
    p, grey = np.concatenate(means), np.concatenate(greys)
    return pack_cloud(
        GaussianCloud(
            means_m=p.astype(np.float32),
            quats_wxyz=np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (len(p), 1)),
            scales_m=np.full((len(p), 3), 0.12, dtype=np.float32),
            opacities=np.full(len(p), 0.99, dtype=np.float32),
            sh=np.repeat((grey[:, None, None] - 0.5) / 0.28209479, 3, axis=2).astype(np.float32),
        )
    )


def human_map() -> OccupancyMap:
    """Free but for a border of half a metre, and a block in the south-west."""
    occupied = np.ones((CELLS, CELLS), dtype=np.bool_)
    occupied[2:-2, 2:-2] = False
    occupied[:9, :9] = True
    return OccupancyMap(frame=FRAME, occupied=occupied)


def flat_floor() -> FloorMap:
    return FloorMap(frame=FRAME, height_m=np.zeros((CELLS, CELLS), dtype=np.float32))


def light(probes: LightProbes, x_m: float, y_m: float, normal: list[float]) -> float:
    return float(irradiance(probes.at(x_m, y_m), np.array([normal])).mean())


@pytest.fixture(scope="module")
def bright_east() -> LightProbes:
    return make_probes([room({"east": 1.0, "west": 0.2})], human_map(), flat_floor())


def test_even_light_leaves_colours_as_they_are() -> None:
    probes = make_probes([room({})], human_map(), flat_floor())
    for normal in (UP, DOWN, EAST, WEST):
        assert light(probes, 3.3, 3.7, normal) == pytest.approx(1.0, abs=0.03)


def test_light_comes_from_the_bright_side_and_more_of_it_near_there(bright_east: LightProbes) -> None:
    assert light(bright_east, 3.0, 3.0, EAST) > 1.5 * light(bright_east, 3.0, 3.0, WEST)
    assert light(bright_east, 5.0, 4.0, EAST) > 1.1 * light(bright_east, 2.0, 4.0, EAST)
    assert light(bright_east, 3.0, 4.5, UP) == pytest.approx(light(bright_east, 3.0, 4.5, DOWN), rel=0.2)


def test_light_changes_gradually_and_is_there_beyond_the_free_area_too(bright_east: LightProbes) -> None:
    along = [light(bright_east, x_m, 4.2, EAST) for x_m in np.arange(-2.0, 8.0, 0.05)]
    assert np.abs(np.diff(along)).max() < 0.1
    assert np.isfinite(along).all()
    assert light(bright_east, 0.5, 0.5, EAST) > light(bright_east, 0.5, 0.5, WEST)


def test_a_scene_without_a_sky_is_not_lit_from_below() -> None:
    # Only the ground can be seen: the rest sends the same light.
    ground = room({})
    keep = ground.centre_m[:, 2] < 0.3
    arrays = {name: getattr(ground, name)[keep] for name in ("centre_m", "half_m", "reach_m", "geometry", "colour")}
    probes = make_probes([PackedScene(**arrays, sh=ground.sh, sh_step=ground.sh_step)], human_map(), flat_floor())
    assert light(probes, 3.0, 3.0, UP) == pytest.approx(light(probes, 3.0, 3.0, DOWN), rel=0.1)


def test_nowhere_to_walk_is_even_light() -> None:
    blocked = OccupancyMap(frame=FRAME, occupied=np.ones((CELLS, CELLS), dtype=np.bool_))
    assert light(make_probes([room({})], blocked, flat_floor()), 1.0, 1.0, UP) == pytest.approx(1.0)


def test_probes_are_made_once_and_again_where_the_file_is_damaged(bright_east: LightProbes, tmp_path: Path) -> None:
    made = []

    def make() -> LightProbes:
        made.append(1)
        return bright_east

    path = tmp_path / "cache" / "light.npz"
    load_or_make_probes(path, make)
    loaded = load_or_make_probes(path, make)
    assert len(made) == 1
    assert np.array_equal(loaded.sh, bright_east.sh)
    assert np.array_equal(loaded.at(1.3, 2.2), bright_east.at(1.3, 2.2))
    path.write_bytes(path.read_bytes()[:200])
    assert np.array_equal(load_or_make_probes(path, make).sh, bright_east.sh)
    assert len(made) == 2


def test_probes_are_had_where_nothing_can_be_written(bright_east: LightProbes, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    assert load_or_make_probes(tmp_path / "file" / "light.npz", lambda: bright_east) is bright_east


def test_light_of_a_room_is_as_it_was(bright_east: LightProbes, golden_figures) -> None:
    places = np.random.default_rng(1).uniform(-0.5, 6.5, (40, 2))
    golden_figures("lighting/probes", np.array([bright_east.at(x, y).ravel() for x, y in places.tolist()]))
