import copy
import dataclasses
import io
import json
import os
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.common.dataset import Dataset, ShardWriter, encode_episode, shard_name
from readygo.common.dataset.index import (
    EPISODE_DTYPE,
    IndexRows,
    build_index,
    index_path,
    load_index,
    map_file,
    read_index,
    tail_offset,
    write_index,
)
from readygo.common.dataset.provenance import Provenance
from readygo.common.errors import DatasetError
from tests.common.dataset.episodes import PROVENANCE, make_episode, write_shard


def damage(shard, needle, *, skip=0):
    """Flip one bit of a shard behind some bytes."""
    data = bytearray(shard.read_bytes())
    data[data.index(needle) + skip] ^= 1
    shard.write_bytes(data)


@pytest.fixture
def shard(tmp_path):
    return write_shard(tmp_path, [4, 2], outputs=("depth",))


def test_index_finds_every_image_and_episode(shard) -> None:
    index = load_index(shard)
    assert index.provenance == PROVENANCE
    assert [index.episode_key(row).index for row in (0, 1)] == [4, 2]
    assert index.episodes["first_sample"].tolist() == [0, 12]
    data = shard.read_bytes()
    samples = [sample for number in (4, 2) for sample in make_episode(number, outputs=("depth",))[1]]
    for row, sample in enumerate(samples):
        place = index.samples[row]
        offset = int(place["image_offset"])
        assert data[offset : offset + int(place["image_length"])] == sample.image
        depth = index.outputs["depth"][row]
        offset = int(depth["offset"])
        assert data[offset : offset + int(depth["length"])] == sample.outputs["depth"]


def test_index_tells_what_each_robot_drew(tmp_path) -> None:
    chunks = [encode_episode(*_with_robot(number, 0.2 + 0.1 * number)) for number in (1, 2)]
    path = tmp_path / shard_name("r0", 0)
    with ShardWriter(path, PROVENANCE, outputs=("drawn",), fsync=False) as writer:
        for chunk in chunks:
            writer.append(chunk)
    kept = read_index(index_path(path))
    index_path(path).unlink()
    for index in (kept, load_index(path)):
        assert index.drawn == ({"mount_height_m": pytest.approx(0.3)}, {"mount_height_m": 0.4})
    drawn = [entry.drawn for entry in Dataset(tmp_path).episodes]
    assert drawn == list(kept.drawn)


def _with_robot(number, height_m):
    header, samples = make_episode(number, drawn={"mount_height_m": height_m})
    return header, 1, samples


def test_missing_index_is_made_again_as_it_was(shard) -> None:
    before = index_path(shard).read_bytes()
    index_path(shard).unlink()
    load_index(shard)
    assert index_path(shard).read_bytes() == before


@pytest.mark.parametrize("kept", [True, False])
def test_index_of_other_bytes_is_made_again(shard, tmp_path, kept) -> None:
    other = write_shard(tmp_path / "other", [4, 3] if kept else [4], outputs=("depth",))
    index_path(shard).write_bytes(index_path(other).read_bytes())
    assert [int(row["index"]) for row in load_index(shard).episodes] == [4, 2]


def test_damaged_episode_is_refused_when_the_index_is_made(shard) -> None:
    index_path(shard).unlink()
    damage(shard, make_episode(2)[1][7].image, skip=40)
    with pytest.raises(DatasetError, match="does not match its CRC-32; see `readygo validate"):
        load_index(shard)
    assert not index_path(shard).exists()


def test_shard_without_its_end_is_refused(shard) -> None:
    shard.write_bytes(shard.read_bytes()[:-1])
    with pytest.raises(DatasetError, match="its end is missing"):
        load_index(shard)
    shard.write_bytes(b"")
    with pytest.raises(DatasetError, match="cannot be read"):
        load_index(shard)


def test_index_that_is_damaged_or_of_another_layout_is_none(shard) -> None:
    path = index_path(shard)
    index = read_index(path)
    assert index is not None
    rows = index.episodes[list(EPISODE_DTYPE.names[:-1])]
    write_index(dataclasses.replace(index, episodes=rows), path)
    assert read_index(path) is None
    write_index(dataclasses.replace(index, outputs={"depth": index.outputs["depth"][:-1]}), path)
    assert read_index(path) is None
    path.write_bytes(b"no index")
    assert read_index(path) is None
    path.unlink()
    assert read_index(path) is None


@pytest.mark.parametrize("name", ["provenance", "size_bytes", "tail_sha256", "episodes", "samples", "outputs"])
def test_indexes_are_equal_if_all_of_them_is(shard, name) -> None:
    with map_file(shard) as view:
        index, same = build_index(view, shard), build_index(view, shard)
        assert tail_offset(view, shard) > len(view) // 2
    assert index.equals(same)
    value = getattr(index, name)
    if isinstance(value, Provenance):
        other = dataclasses.replace(value, seed=8)
    else:
        other = {} if isinstance(value, dict) else value[:-1] if isinstance(value, np.ndarray) else value * 2
    assert not index.equals(dataclasses.replace(same, **{name: other}))


def test_index_of_nothing_is_empty() -> None:
    index = IndexRows().index(PROVENANCE, size_bytes=10, tail=b"x")
    assert (len(index.episodes), len(index.samples), index.outputs) == (0, 0, {})
    assert index.provenance == PROVENANCE


def test_missing_or_stale_index_is_made_again(two_shards) -> None:
    shard = two_shards / "shard-r0-00000.mcap"
    want = index_path(shard).read_bytes()
    for content in (None, b"", b"damaged", index_path(two_shards / "shard-r0-00001.mcap").read_bytes()):
        index_path(shard).unlink()
        if content is not None:
            index_path(shard).write_bytes(content)
        assert len(Dataset([two_shards])) == 54
        assert index_path(shard).read_bytes() == want


def test_index_of_a_changed_shard_of_the_same_size_is_not_used(two_shards) -> None:
    shard = two_shards / "shard-r0-00000.mcap"
    index = index_path(shard).read_bytes()
    size = shard.stat().st_size
    write_shard(two_shards, [4, 0], number=0, goal_xy_m=(3.0, 1.0))
    index_path(shard).write_bytes(index)
    assert shard.stat().st_size == size
    assert Dataset([two_shards]).goals_xy_m[0] == pytest.approx(
        make_episode(0, goal_xy_m=(3.0, 1.0))[1][0].goal_xy_robot_m
    )


def test_dataset_without_indexes_in_a_folder_that_cannot_be_written(two_shards, monkeypatch) -> None:
    for path in two_shards.glob("*.index"):
        path.unlink()

    def refuse(*arguments: object, **options: object) -> None:
        raise PermissionError("read-only file system")

    monkeypatch.setattr("readygo.common.dataset.index.write_index", refuse)
    assert len(Dataset([two_shards])) == 54


def test_written_index_equals_the_rebuilt_one(two_shards) -> None:
    shard = two_shards / "shard-r0-00001.mcap"
    with map_file(shard) as view:
        rebuilt = build_index(view, shard)
    stored = read_index(index_path(shard))
    assert stored is not None
    assert stored.equals(rebuilt)
    assert load_index(shard).equals(rebuilt)


def test_index_two_rich_shards_is_made_again_as_it_was(two_rich_shards) -> None:
    shard = two_rich_shards / "shard-r0-00001.mcap"
    stored, want = read_index(index_path(shard)), index_path(shard).read_bytes()
    index_path(shard).unlink()
    assert stored is not None
    assert list(stored.outputs) == ["depth", "alpha", "mask"]
    assert load_index(shard).equals(stored)
    assert index_path(shard).read_bytes() == want


def test_indexes_that_differ_in_the_place_of_an_output_are_not_equal(two_rich_shards) -> None:
    index = load_index(two_rich_shards / "shard-r0-00000.mcap")
    other = copy.deepcopy(index)
    assert index.equals(other)
    other.outputs["mask"]["offset"][3] += 1
    assert not index.equals(other)
    del other.outputs["mask"]
    assert not index.equals(other)


def _stored(array: np.ndarray) -> bytes:
    buffer = io.BytesIO()
    np.save(buffer, array)
    return buffer.getvalue()


def _rewritten(path: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """Write an index file with other arrays; bytes stand for entries as they are."""
    with np.load(path) as file:
        arrays: dict[str, Any] = dict(file)
    change(arrays)
    with zipfile.ZipFile(path, "w") as archive:
        for name, array in arrays.items():
            archive.writestr(f"{name}.npy", array if isinstance(array, bytes) else _stored(array))


def _changed_header(arrays: dict[str, Any], **fields: Any) -> None:
    header = json.loads(arrays["header"].tobytes()) | fields
    arrays["header"] = np.frombuffer(json.dumps(header).encode(), np.uint8)


def _field(name: str, field: str, value: Any) -> Callable[[dict[str, Any]], Any]:
    return lambda arrays: arrays[name][field].__setitem__(0, value)


_SIGFPE = b"\x93NUMPY\x01\x00F\x00" + b"{'descr': 'm8[s/0]', 'fortran_order': False, 'shape': (), }".ljust(69) + b"\n"


@pytest.mark.parametrize(
    "change",
    [
        lambda arrays: arrays.update(header=_SIGFPE),
        lambda arrays: arrays.update(output_x=_SIGFPE),
        lambda arrays: arrays.update(header=b"text"),
        lambda arrays: arrays.update(header=np.frombuffer(b"[" * 100_000, np.uint8)),
        lambda arrays: arrays.update(header=np.frombuffer(b"[]", np.uint8)),
        lambda arrays: arrays.update(samples=arrays["samples"][:-1]),
        lambda arrays: arrays.update(episodes=np.array(arrays["episodes"][0])),
        lambda arrays: _changed_header(arrays, size_bytes=None),
        lambda arrays: _changed_header(arrays, drawn=[1, 2, 3]),
        lambda arrays: _changed_header(arrays, metadata={"scene": [1]}),
        _field("episodes", "split", b"\xff"),
        _field("episodes", "split", b"other"),
        _field("episodes", "sha256", b"\xff"),
        _field("episodes", "first_sample", 5),
        _field("episodes", "sample_count", 4_000_000_000),
        _field("samples", "image_offset", 2**64 - 1),
        _field("samples", "image_length", 4_000_000_000),
    ],
)
def test_damaged_index_is_made_again(two_shards: Path, change: Callable[[dict[str, Any]], Any]) -> None:
    """The first one ends a process in which NumPy reads it, with SIGFPE."""
    shard = two_shards / "shard-r0-00000.mcap"
    want = index_path(shard).read_bytes()
    _rewritten(index_path(shard), change)
    assert index_path(shard).read_bytes() != want
    assert read_index(index_path(shard)) is None
    assert load_index(shard).episode_key(0).index >= 0
    assert index_path(shard).read_bytes() == want


def test_mutated_index_is_used_or_made_again(two_shards: Path) -> None:
    shard = two_shards / "shard-r0-00000.mcap"
    want, rng = index_path(shard).read_bytes(), np.random.default_rng(0)
    for _ in range(300):
        data = bytearray(want)
        for at in rng.integers(0, len(data), 4):
            data[at] = rng.integers(256)
        index_path(shard).write_bytes(data)
        read_index(index_path(shard))


def test_pipe_that_is_called_as_a_shard_is_refused_and_not_waited_for(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "shard-rec0-00000.mcap")
    for read in (lambda: load_index(tmp_path / "shard-rec0-00000.mcap"), lambda: Dataset([tmp_path])):
        with pytest.raises(DatasetError, match=r"shard-rec0-00000\.mcap cannot be read: it is a pipe or a device"):
            read()
