import hashlib
from pathlib import Path

import pytest

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
