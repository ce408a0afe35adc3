import numpy as np
import pytest

from readygo.benchmarks.planning import maps as plan_maps
from readygo.benchmarks.planning.maps import MapSource, find_map, open_maps
from readygo.common.errors import ConfigError, SceneError
from readygo.common.gaussians import save_ply
from readygo.common.maps import GridFrame, OccupancyMap, save_ros_map
from tests.common.maps.room import room

FRAME = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.05)


@pytest.fixture
def data(tmp_path):
    folder = tmp_path / "data"
    (folder / "maps" / "robots").mkdir(parents=True)
    (folder / "scenes").mkdir()
    for name in ("cellar", "UMA_236_237"):
        save_ros_map(
            OccupancyMap(frame=FRAME, occupied=np.zeros((4, 6), np.bool_)), folder / f"maps/robots/{name}.yaml"
        )
    (folder / "maps" / "city.map").write_text("type octile\nheight 1\nwidth 2\nmap\n.@\n")
    return folder


def test_bare_names_and_short_names_are_found_below_the_data_folder(data):
    assert find_map("cellar", data) == MapSource(name="cellar", path=str(data / "maps/robots/cellar.yaml"))
    assert find_map("home", data) == MapSource(name="home", path=str(data / "maps/robots/UMA_236_237.yaml"))


def test_paths_need_no_data_folder(data):
    path = data / "maps/robots/cellar.yaml"
    assert find_map(str(path), None) == MapSource(name="cellar", path=str(path))


def test_maps_of_a_flat_map_are_one_map_on_level_ground(data):
    maps = open_maps(find_map("cellar", data))
    assert maps.human is maps.robot
    assert maps.floor.height_m.shape == maps.robot.occupied.shape
    assert not maps.floor.height_m.any()
    city = open_maps(find_map("city", data))
    assert city.robot.occupied.tolist() == [[False, True]]
    assert city.robot.frame.resolution_m == plan_maps.CITY_CELL_M


def test_unknown_names_are_answered_with_what_there_is(data, tmp_path):
    (data / "scenes" / "hall.compressed.ply").touch()
    (data / "scenes" / "hall_env.compressed.ply").touch()
    with pytest.raises(ConfigError, match=r"holds UMA_236_237, cellar, city, hall, home, willow\.") as caught:
        find_map("nowhere", data)
    assert "\n" not in str(caught.value)
    with pytest.raises(ConfigError, match="holds nothing"):
        find_map("nowhere", tmp_path)
    with pytest.raises(ConfigError, match="--data"):
        find_map("nowhere", None)


def test_folder_that_is_no_bundle_is_refused_when_it_is_opened(data):
    with pytest.raises(SceneError):
        open_maps(find_map(str(data), None))


def test_scene_is_imported_once_with_its_sky(data, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    cloud = room()
    save_ply(cloud, data / "scenes" / "hall.ply")
    save_ply(cloud.select(np.arange(10)), data / "scenes" / "hall_env.ply")
    first = find_map("hall", data)
    assert sorted(path.name for path in (tmp_path / "cache/readygo/bench-scenes").iterdir()) == [
        first.path.split("/")[-1]
    ]
    assert open_maps(first).robot.occupied.any()
    assert plan_maps.open_scene(first.path).sky is not None

    def refuse(*arguments, **options):
        raise AssertionError("imported twice")

    monkeypatch.setattr(plan_maps, "import_scene", refuse)
    assert find_map("hall", data) == first


def test_scene_that_another_process_imports_meanwhile_is_used(data, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (data / "scenes" / "hall.ply").write_bytes(b"some")

    def beaten(source, out, **options):
        out.mkdir(parents=True)
        raise SceneError(f"{out} exists already")

    monkeypatch.setattr(plan_maps, "import_scene", beaten)
    assert "hall-" in find_map("hall", data).path


def test_scene_that_cannot_be_imported_is_refused(data, tmp_path, monkeypatch):
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    (data / "scenes" / "hall.ply").write_bytes(b"no Gaussians")
    with pytest.raises(SceneError):
        find_map("hall", data)
