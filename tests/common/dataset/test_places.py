from pathlib import Path

import pytest

from readygo.common.dataset.places import (
    MARK,
    NOTE,
    absent,
    find_shards,
    note_folders,
    own_folders,
    present_folders,
    shard_folders,
)
from readygo.common.errors import DatasetError


def test_folder_without_a_note_holds_all_shards(tmp_path: Path) -> None:
    note_folders(tmp_path, {})
    assert shard_folders(tmp_path) == [tmp_path]
    assert list(tmp_path.iterdir()) == []


def test_folders_of_recorders_follow(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    note_folders(tmp_path, {"east": disk})
    with pytest.raises(DatasetError, match=r"The folder of recorder east, .*disk, is not there"):
        shard_folders(tmp_path)
    assert present_folders(tmp_path) == [tmp_path]
    assert "recorder east" in absent(tmp_path)
    disk.mkdir()
    (disk / MARK).touch()
    assert shard_folders(tmp_path) == present_folders(tmp_path) == [tmp_path, disk]
    assert absent(tmp_path) == ""
    note_folders(tmp_path, {})
    assert own_folders(tmp_path) == {}


@pytest.mark.parametrize("text", ["[1]", "{", '{"a": 1}'])
def test_note_that_is_none_is_named(text: str, tmp_path: Path) -> None:
    (tmp_path / NOTE).write_text(text)
    with pytest.raises(DatasetError, match=r"recorders\.json, which says where .* cannot be read"):
        shard_folders(tmp_path)


def test_missing_folder_and_folder_without_shards_are_named(tmp_path) -> None:
    with pytest.raises(DatasetError, match="nowhere does not exist; record one"):
        find_shards(tmp_path / "nowhere")
    with pytest.raises(DatasetError, match="holds no finished shards"):
        find_shards(tmp_path)
    (tmp_path / "shard-r0-00000.mcap.part").write_bytes(b"")
    with pytest.raises(DatasetError, match="1 are still being written"):
        find_shards(tmp_path)


def test_scene_and_file_are_no_data_folders(tmp_path: Path) -> None:
    (tmp_path / "scene.toml").touch()
    for scene in (tmp_path, Path("embedded"), Path("embedded:plan-1")):
        with pytest.raises(DatasetError, match=f"is a scene, no data folder; look at it with `.*inspect {scene}`"):
            find_shards(scene)
    with pytest.raises(DatasetError, match=r"scene\.toml is a file; name the data folder"):
        find_shards(tmp_path / "scene.toml")


def test_data_folder_may_have_the_name_of_a_scene(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    shard = Path("embedded/shard-r0-00000.mcap")
    shard.parent.mkdir()
    shard.touch()
    assert find_shards("embedded") == [shard]


def test_deep_note_is_refused(tmp_path: Path) -> None:
    (tmp_path / "recorders.json").write_text("[" * 100_000)
    with pytest.raises(DatasetError, match="nest deeper"):
        own_folders(tmp_path)
