from pathlib import Path

import pytest

from readygo.apps.sweep import identity
from readygo.apps.sweep.identity import content_sha256, point_sha256
from readygo.common.errors import ConfigError, SceneError
from tests.apps.sweep.sweeps import read_sweep

TRAIN = 'command = "train"\nseeds = [0, 1]\n[options]\nsamples = 10\n[arms.a]\ndata = ["DATA"]'


def _hash(folder: Path, text: str) -> str:
    content_sha256.cache_clear()
    sweep = read_sweep(folder, text)
    return point_sha256(sweep, sweep.points[0])


def _data(folder: Path, text: str = "one") -> Path:
    folder.mkdir()
    (folder / "shard").write_text(text)
    return folder


def test_hash_follows_options_and_content_and_not_the_place(tmp_path: Path) -> None:
    text = TRAIN.replace("DATA", str(_data(tmp_path / "a")))
    first = _hash(tmp_path, text)
    assert _hash(tmp_path, TRAIN.replace("DATA", str(_data(tmp_path / "b")))) == first
    assert _hash(tmp_path, TRAIN.replace("DATA", str(_data(tmp_path / "c", "two")))) != first
    assert _hash(tmp_path, text.replace("samples = 10", "samples = 11")) != first
    assert _hash(tmp_path, text.replace("[0, 1]", "[1]")) != first
    assert _hash(tmp_path, text.replace("[arms.a]", "[arms.b]")) == first


def test_hash_follows_the_version(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    text = 'command = "rl"\nscenes = ["embedded"]'
    first = _hash(tmp_path, text)
    monkeypatch.setattr(identity.importlib.metadata, "version", lambda _: "9.9")
    assert _hash(tmp_path, text) != first


def test_hash_follows_the_drivers_files(tmp_path: Path) -> None:
    driver = tmp_path / "mine.py"
    text = f'command = "evaluate"\nscenes = ["embedded"]\n[options]\nmethods = ["{driver}:MyDriver"]'
    driver.write_text("a = 1")
    first = _hash(tmp_path, text)
    driver.write_text("a = 2")
    assert _hash(tmp_path, text) != first


def test_place_of_checkpoints_does_not_count(tmp_path: Path) -> None:
    text = 'command = "evaluate"\nscenes = ["embedded"]\n[options]\nmethods = ["expert"]\ncheckpoints = "a"'
    assert _hash(tmp_path, text) == _hash(tmp_path, text.replace('"a"', '"b/c/"'))


def test_suite_is_hashed(tmp_path: Path) -> None:
    text = 'command = "benchmark run"\n[options]\nsuite = "SUITE"\ndrivers = ["expert"]'
    suite = Path(identity.open_suite.__code__.co_filename).parent / "suites" / "pedestrian-nav-1.toml"
    copy = tmp_path / "suite.toml"
    copy.write_bytes(suite.read_bytes())
    assert _hash(tmp_path, text.replace("SUITE", str(copy))) == _hash(
        tmp_path, text.replace("SUITE", "pedestrian-nav/1")
    )


def test_missing_inputs_are_named(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="The input nothing does not exist"):
        _hash(tmp_path, TRAIN.replace("DATA", "nothing"))
    with pytest.raises(SceneError):
        _hash(tmp_path, 'command = "rl"\nscenes = ["nothing"]')


def test_part_of_avatars_is_no_part_of_the_path(tmp_path: Path) -> None:
    people = _data(tmp_path / "people")
    text = f'command = "rl"\nscenes = ["embedded"]\n[options]\navatars = "{people}:train"'
    first = _hash(tmp_path, text)
    assert _hash(tmp_path, text.replace(":train", ":test")) != first
    (people / "shard").write_text("two")
    assert _hash(tmp_path, text) != first
    assert _hash(tmp_path, 'command = "rl"\nscenes = ["embedded"]\n[options]\navatars = "embedded:train"')


def test_folder_is_its_visible_files_by_name(tmp_path: Path) -> None:
    folder = _data(tmp_path / "a")
    first = content_sha256(folder)
    content_sha256.cache_clear()
    (folder / ".hidden").mkdir()
    (folder / ".hidden" / "x").write_text("x")
    assert content_sha256(folder) == first
    content_sha256.cache_clear()
    (folder / "shard").rename(folder / "other")
    assert content_sha256(folder) != first


def test_every_byte_counts(tmp_path: Path) -> None:
    path = tmp_path / "shard"
    hashes = set()
    for place in (None, 0, 2**20, 2**21 - 1):
        data = bytearray(2**21)
        if place is not None:
            data[place] = 1
        path.write_bytes(data)
        content_sha256.cache_clear()
        hashes.add(content_sha256(path))
    assert len(hashes) == 4
