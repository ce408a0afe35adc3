import dataclasses
import hashlib
import shutil
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import msgpack
import pytest

from readygo.common.avatars.file import avatar_paths
from readygo.common.bus import InProcessBus
from readygo.common.errors import AvatarError, MessageError, RunError
from readygo.common.messages import BlobReply, FileRef, RunSpec, Split, decode, encode, topics
from readygo.runs.config import RunConfig
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.runs.world import World
from tests.runs.served import served


@pytest.fixture
def spec() -> RunSpec:
    return make_spec(open_scene("embedded"), None, RunConfig(), seed=0, split=Split.TRAIN, static=True)


@pytest.fixture
def bus(spec: RunSpec, tmp_path: Path) -> InProcessBus:
    return served(spec, tmp_path)


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


def test_file_of_the_cache_that_is_damaged_is_fetched_anew(bus: InProcessBus, elsewhere: RunSpec) -> None:
    cloud = World(elsewhere, bus).scene.path / "scene.ply"
    data = cloud.read_bytes()
    cloud.write_bytes(data[:-1] + bytes([data[-1] ^ 1]))
    assert World(elsewhere, bus).scene.path == cloud.parent
    assert cloud.read_bytes() == data


def test_another_scene_at_the_path_of_the_runs_is_not_taken_for_it(
    bus: InProcessBus, elsewhere: RunSpec, tmp_path: Path
) -> None:
    other = open_scene("embedded:7").path
    spec = dataclasses.replace(elsewhere, scene_path=str(other))
    assert World(spec, bus).scene.content_hash == elsewhere.scene_hash
    with pytest.raises(RunError, match="has changed since the run began"):
        _ = World(spec).scene


def test_map_is_shown_where_the_scene_is(bus: InProcessBus, spec: RunSpec, elsewhere: RunSpec) -> None:
    here, there = World(spec).stage(), World(elsewhere, bus).stage()
    assert here.robot == there.robot == RunConfig().robot
    assert here.maps is not None
    assert here.maps.robot.occupied.any()
    assert there.maps is None


def _rogue(tmp_path: Path) -> InProcessBus:
    """A coordinator that answers with a file that the run does not need."""
    bus = InProcessBus()
    bus.serve(topics.BLOB, lambda _: BlobReply(size=len(EVIL), data=EVIL))
    return bus


EVIL = b"* * * * * root touch /tmp/owned"
EVIL_FILE = FileRef(path="cron.d/evil", sha256=hashlib.sha256(EVIL).hexdigest(), size=len(EVIL))


@pytest.mark.parametrize("place", ["{tmp_path}/etc", "../../../etc", "..", "", "/"])
@pytest.mark.parametrize("path", ["cron.d/evil", "../evil", "../../../etc/evil", "{tmp_path}/etc/evil"])
def test_rogue_coordinator_writes_nothing_outside_of_the_cache(
    elsewhere: RunSpec, tmp_path: Path, place: str, path: str
) -> None:
    """Neither where the spec's class lets these pass."""
    place, path = place.format(tmp_path=tmp_path), path.format(tmp_path=tmp_path)
    fields = msgpack.unpackb(encode(elsewhere))
    with pytest.raises(MessageError, match="is no RunSpec: scene_hash must be 64 hexadecimal digits"):
        decode(RunSpec, msgpack.packb(fields | {"scene_hash": place}))
    file = dataclasses.replace(EVIL_FILE)
    object.__setattr__(file, "path", path)
    for scene_hash in (place, elsewhere.scene_hash):
        spec = dataclasses.replace(elsewhere, scene_files=(file,))
        object.__setattr__(spec, "scene_hash", scene_hash)
        if (scene_hash, path) == (elsewhere.scene_hash, "cron.d/evil"):
            continue
        with pytest.raises(RunError, match="outside of its bundle"):
            _ = World(spec, _rogue(tmp_path)).scene
    assert [entry for entry in tmp_path.rglob("*") if entry.name.endswith(("evil", ".part", ".lock"))] == []


def test_scene_file_that_the_run_does_not_have_is_an_error(bus: InProcessBus, elsewhere: RunSpec) -> None:
    missing = FileRef(path="scene.ply", sha256="0" * 64, size=1)
    with pytest.raises(RunError, match=r"scene\.ply of the run is gone, or has changed, where the run began"):
        _ = World(dataclasses.replace(elsewhere, scene_files=(missing,)), bus).scene


def test_avatars_are_fetched_like_the_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    people = tmp_path / "people"
    people.mkdir()
    for file in avatar_paths(None)[:2]:
        shutil.copy(file, people)
    spec = make_spec(open_scene("embedded"), people, RunConfig(), seed=0, split=Split.TRAIN, static=False)
    bus = served(spec, tmp_path)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    elsewhere = dataclasses.replace(spec, avatars_path=str(tmp_path / "not-here"))
    assert sorted(World(elsewhere, bus).avatars) == sorted(spec.avatar_hashes)
    first = sorted(people.iterdir())[0]
    first.write_bytes(first.read_bytes()[:-1] + b"x")
    shutil.rmtree(tmp_path / "cache")
    with pytest.raises(RunError, match=f"File {first.name} of the run does not match its hash"):
        _ = World(elsewhere, bus).avatars
    with pytest.raises(AvatarError, match="does not exist"):
        _ = World(elsewhere).avatars
