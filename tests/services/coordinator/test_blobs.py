import errno
import hashlib
import os
from pathlib import Path

import pytest

from readygo.common.errors import DiskError
from readygo.services.coordinator import BlobStore

DATA = bytes(range(100))
SHA256 = hashlib.sha256(DATA).hexdigest()


@pytest.fixture
def store(tmp_path: Path) -> BlobStore:
    return BlobStore(tmp_path / "blobs")


def test_blob_comes_back_under_its_hash(store: BlobStore) -> None:
    assert store.put(DATA) == SHA256
    assert store.put(DATA) == SHA256
    assert store.get(SHA256) == DATA


@pytest.mark.parametrize(("offset", "count", "end"), [(0, 7, 7), (95, 7, 100), (100, 7, 100), (40, -1, 100)])
def test_part_of_a_blob_comes_with_the_size_of_all(store: BlobStore, offset: int, count: int, end: int) -> None:
    store.put(DATA)
    assert store.read(SHA256, offset, count) == (100, DATA[offset:end])


def test_unknown_blob_has_no_size(store: BlobStore) -> None:
    assert store.read("0" * 64, 0, 10) == (-1, b"")
    assert store.get("0" * 64) is None


def test_name_that_leads_out_of_the_folder_is_unknown(store: BlobStore, tmp_path: Path) -> None:
    (tmp_path / "secret").write_bytes(b"x")
    assert store.get("../secret") is None


def test_files_of_the_scene_are_served_from_their_place(tmp_path: Path) -> None:
    (tmp_path / "scene.ply").write_bytes(DATA)
    store = BlobStore(tmp_path / "blobs", {SHA256: tmp_path / "scene.ply"})
    assert store.get(SHA256) == DATA
    store.keep_only(set())
    assert store.get(SHA256) == DATA


def test_only_what_is_needed_stays(store: BlobStore) -> None:
    other = store.put(b"other")
    store.put(DATA)
    store.keep_only({SHA256})
    assert store.get(SHA256) == DATA
    assert store.get(other) is None
    store.drop(SHA256)
    store.drop(SHA256)
    assert store.get(SHA256) is None


def test_blob_that_the_disk_does_not_take_is_said_and_leaves_nothing(
    store: BlobStore, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(descriptor: int, data: bytes) -> int:
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(os, "write", full)
    with pytest.raises(DiskError, match=f"{SHA256} cannot be written: No space left on device"):
        store.put(DATA)
    assert list((tmp_path / "blobs").iterdir()) == []


def test_what_a_crash_left_half_written_is_written_again_or_goes_with_the_next_start(
    store: BlobStore, tmp_path: Path
) -> None:
    other = tmp_path / "blobs" / ("0" * 64)
    for path in (tmp_path / "blobs" / SHA256, other):
        path.write_bytes(DATA[:10])
    store.keep_only({store.put(DATA)})
    assert store.get(SHA256) == DATA
    assert not other.exists()


def test_blobs_that_the_system_takes_and_gives_in_pieces_are_whole(
    store: BlobStore, monkeypatch: pytest.MonkeyPatch
) -> None:
    write, read = os.write, os.pread
    monkeypatch.setattr(os, "write", lambda descriptor, data: write(descriptor, data[:7]))
    monkeypatch.setattr(os, "pread", lambda descriptor, count, offset: read(descriptor, min(count, 3), offset))
    assert store.put(DATA) == SHA256
    assert store.get(SHA256) == DATA
    assert store.read(SHA256, 41, 11) == (100, DATA[41:52])
    assert store.read(SHA256, 120, 5) == (100, b"")
    assert store.read(SHA256, 3, 0) == (100, b"")
