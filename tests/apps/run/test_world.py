import dataclasses
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from readygo.apps.fleet.worker import make_coordinator
from readygo.apps.run.config import RunConfig
from readygo.apps.run.folder import RunFolder
from readygo.apps.run.scene_argument import open_scene
from readygo.apps.run.spec import make_spec
from readygo.apps.run.world import World
from readygo.common.bus import InProcessBus
from readygo.common.errors import RunError
from readygo.common.messages import FileRef, RunSpec, Split
from readygo.services.coordinator import attach


@pytest.fixture
def spec() -> RunSpec:
    return make_spec(open_scene("embedded"), None, RunConfig(), seed=0, split=Split.TRAIN, static=True)


@pytest.fixture
def bus(spec: RunSpec, tmp_path: Path) -> InProcessBus:
    folder = RunFolder(tmp_path / "data")
    with folder.locked():
        folder.save(spec, 1)
    bus = InProcessBus()
    attach(bus, make_coordinator(folder))
    return bus


@pytest.fixture
def elsewhere(spec: RunSpec, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> RunSpec:
    """The run as it looks on a machine that has neither the scene nor a cache."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return dataclasses.replace(spec, scene_path=str(tmp_path / "not-here"))


def test_workers_of_a_machine_without_the_scene_fetch_it_from_the_run(bus: InProcessBus, elsewhere: RunSpec) -> None:
    with ThreadPoolExecutor(3) as workers:
        scenes = list(workers.map(lambda _: World(elsewhere, bus).scene, range(3)))
    for scene in scenes:
        assert scene.content_hash == elsewhere.scene_hash
        assert scene.maps.robot.occupied.any()


def test_fetched_scene_that_is_not_what_its_hashes_say_is_refused(bus: InProcessBus, elsewhere: RunSpec) -> None:
    cloud = World(elsewhere, bus).scene.path / "scene.ply"
    data = bytearray(cloud.read_bytes())
    data[-1] ^= 1
    cloud.write_bytes(data)
    with pytest.raises(RunError, match=r"came from the run cannot be used; remove .* scene\.ply has changed"):
        _ = World(elsewhere, bus).scene


def test_map_is_shown_where_the_scene_is(bus: InProcessBus, spec: RunSpec, elsewhere: RunSpec) -> None:
    here, there = World(spec).stage(), World(elsewhere, bus).stage()
    assert here.robot == there.robot == RunConfig().robot
    assert here.maps is not None
    assert here.maps.robot.occupied.any()
    assert there.maps is None


def test_scene_file_outside_of_the_bundle_is_refused(bus: InProcessBus, elsewhere: RunSpec) -> None:
    evil = dataclasses.replace(elsewhere.scene_files[0], path="../../escaped")
    with pytest.raises(RunError, match="outside of its bundle"):
        _ = World(dataclasses.replace(elsewhere, scene_files=(evil,)), bus).scene


def test_scene_file_that_the_run_does_not_have_is_an_error(bus: InProcessBus, elsewhere: RunSpec) -> None:
    missing = FileRef(path="scene.ply", sha256="0" * 64, size=1)
    with pytest.raises(RunError, match="is not known to the run"):
        _ = World(dataclasses.replace(elsewhere, scene_files=(missing,)), bus).scene


def test_avatars_that_are_not_on_a_workers_machine_are_named(elsewhere: RunSpec, tmp_path: Path) -> None:
    world = World(dataclasses.replace(elsewhere, avatars_path=str(tmp_path / "people")))
    with pytest.raises(RunError, match=f"avatars are not on this machine: copy them to {tmp_path / 'people'}"):
        _ = world.avatars
