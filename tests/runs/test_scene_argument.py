from pathlib import Path

import numpy as np
import pytest

from readygo.common.errors import RunError, SceneError
from readygo.common.maps import save_ros_map
from readygo.common.scenes import embedded
from readygo.runs.scene_argument import FlatMaps, open_maps, open_scene, open_scenes
from tests.services.planner.worlds import rooms


def test_ros_map_lies_on_a_flat_floor(tmp_path: Path) -> None:
    save_ros_map(rooms(), tmp_path / "rooms.yaml")
    maps, scene = open_maps(str(tmp_path / "rooms.yaml"))
    assert scene is None
    assert maps.robot is maps.human
    assert np.array_equal(maps.robot.occupied, rooms().occupied)
    assert maps.floor.height_m.shape == maps.robot.occupied.shape
    assert maps.floor.height_m.max() == 0.0


def test_occupied_cells_hide_humans() -> None:
    maps = FlatMaps(rooms())
    assert maps.sight is maps.sight
    assert maps.sight.sees(1.0, 5.5, 0.5, (2.0, 5.5))
    assert not maps.sight.sees(2.0, 6.0, 0.5, (2.0, 8.5))


def test_scene_that_is_none_is_refused(tmp_path: Path) -> None:
    for name in ("nowhere", "nowhere.yaml"):
        with pytest.raises(SceneError):
            open_maps(str(tmp_path / name))
    with pytest.raises(SceneError, match="does not exist"):
        open_scene(str(tmp_path / "nowhere"))


def test_scenes_are_named_and_each_only_once() -> None:
    with pytest.raises(RunError, match="Name a scene"):
        open_scenes(())
    with pytest.raises(RunError, match="Scene embedded:0 is named twice; name each scene once"):
        open_scenes(("embedded", "embedded:0"))
    (scene,) = open_scenes(("embedded",))
    assert scene.content_hash == open_scene("embedded").content_hash


def test_seed_of_an_embedded_flat_is_checked_before_anything_is_made(monkeypatch: pytest.MonkeyPatch) -> None:
    made: list[tuple[str, int, bool]] = []

    def make(folder: Path, seed: int, *, own_plan: bool) -> None:
        made.append((folder.name, seed, own_plan))

    monkeypatch.setattr(embedded, "ensure_embedded_scene", make)
    for name in ("embedded", "embedded:0", "embedded:12", "embedded:plan-12"):
        open_scene(name)
    assert made == [
        ("embedded", 0, False),
        ("embedded", 0, False),
        ("embedded-12", 12, False),
        ("embedded-plan-12", 12, True),
    ]
    for name in ("", "-1", "1.5", "4294967296", "flat", "plan-", "plan--1", "plan-x", "plan-plan-1"):
        name = f"embedded:{name}"
        with pytest.raises(SceneError, match="whole number"):
            open_scene(name)
