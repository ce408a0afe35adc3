import hashlib
import os
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.errors import BusError, RunError
from readygo.common.fleet import blobs
from readygo.common.fleet.blobs import fetch_blob, fetch_file
from readygo.common.messages import BlobReply, BlobRequest, FileRef, topics

DATA = bytes(range(100))
SHA256 = hashlib.sha256(DATA).hexdigest()


def _bus(data: bytes | None) -> InProcessBus:
    bus = InProcessBus()

    def serve(request: BlobRequest) -> BlobReply:
        if data is None:
            return BlobReply(size=-1, data=b"")
        return BlobReply(size=len(data), data=data[request.offset : request.offset + 7])

    bus.serve(topics.BLOB, serve)
    return bus


def test_blob_is_fetched_in_chunks() -> None:
    assert fetch_blob(_bus(DATA), SHA256) == DATA


def test_empty_blob_is_a_blob() -> None:
    assert fetch_blob(_bus(b""), hashlib.sha256(b"").hexdigest()) == b""


def test_unknown_blob_is_an_error() -> None:
    with pytest.raises(RunError, match=f"Blob {SHA256} is not known to the run"):
        fetch_blob(_bus(None), SHA256)


def test_damaged_blob_is_an_error() -> None:
    with pytest.raises(RunError, match="arrived damaged"):
        fetch_blob(_bus(DATA[:-1] + b"\0"), SHA256)


FILE = FileRef(path="scene.ply", sha256=SHA256, size=len(DATA))


class Server:
    """Serves the file in chunks, and counts what it was asked."""

    def __init__(self, data: bytes = DATA) -> None:
        self.data = data
        self.offsets: list[int] = []
        self.away: set[int] = set()
        """Requests that nobody answers, by their number."""
        self.bus = InProcessBus()
        self.bus.serve(topics.BLOB, self._serve)

    def _serve(self, request: BlobRequest) -> BlobReply:
        self.offsets.append(request.offset)
        return BlobReply(size=len(self.data), data=self.data[request.offset : request.offset + 30])

    def request(self, *args: object, **kwargs: object) -> object:
        if len(self.offsets) in self.away:
            self.away.remove(len(self.offsets))
            raise BusError("Nobody answered.")
        return self.bus.request(*args, **kwargs)  # type: ignore[arg-type]


def test_file_is_downloaded_once_however_many_ask_at_once(tmp_path: Path) -> None:
    server, path = Server(), tmp_path / "cache" / "scene.ply"
    with ThreadPoolExecutor(6) as workers:
        list(workers.map(lambda _: fetch_file(server.bus, FILE, path), range(6)))
    assert path.read_bytes() == DATA
    assert server.offsets == [0, 30, 60, 90]
    assert [entry.name for entry in path.parent.iterdir() if entry.suffix == ".part"] == []


def test_download_that_was_cut_goes_on_where_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    server, path = Server(), tmp_path / "scene.ply"
    monkeypatch.setattr(blobs, "_RETRY_S", 0.0)
    server.away = {2}
    fetch_file(server, FILE, path)  # type: ignore[arg-type]
    assert (path.read_bytes(), server.offsets) == (DATA, [0, 30, 60, 90])

    path.unlink()
    monkeypatch.setattr(blobs, "ABSENT_S", 0.0)
    server.away = {6}
    with pytest.raises(BusError, match="Nobody answered"):
        fetch_file(server, FILE, path)  # type: ignore[arg-type]
    assert not path.exists()
    del server.offsets[:]
    fetch_file(server.bus, FILE, path)
    assert (path.read_bytes(), server.offsets) == (DATA, [60, 90])


def test_file_that_does_not_match_its_hash_is_refused_and_what_was_begun_wrong_is_fetched_anew(tmp_path: Path) -> None:
    path = tmp_path / "scene.ply"
    with pytest.raises(RunError, match=r"scene\.ply of the run does not match its hash"):
        fetch_file(Server(DATA[:-1] + b"x").bus, FILE, path)
    with pytest.raises(RunError, match=r"scene\.ply of the run is gone, or has changed"):
        fetch_file(Server(DATA + b"x").bus, FILE, path)
    assert not path.exists()
    path.with_name(".scene.ply.part").write_bytes(b"y" * 50)
    fetch_file(Server().bus, FILE, path)
    assert path.read_bytes() == DATA
    path.write_bytes(b"z" * len(DATA))
    fetch_file(Server().bus, FILE, path)
    assert path.read_bytes() == DATA


def test_blob_that_is_larger_than_any_message_is_refused_at_once() -> None:
    asked: list[BlobRequest] = []
    bus = InProcessBus()
    bus.serve(topics.BLOB, lambda request: (asked.append(request), BlobReply(size=2**62, data=bytes(1000)))[1])
    with pytest.raises(RunError, match=rf"Blob {SHA256} has {2**62} bytes, more than"):
        fetch_blob(bus, SHA256)
    assert len(asked) == 1


def test_blob_whose_size_grows_ends_at_the_size_of_a_message(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(blobs, "MESSAGE_BYTES_MAX", 10_000)
    bus = InProcessBus()
    bus.serve(topics.BLOB, lambda request: BlobReply(size=min(request.offset + 2000, 10_000), data=bytes(1000)))
    with pytest.raises(RunError, match=r"more than the 10000 of any message|arrived damaged"):
        fetch_blob(bus, SHA256)


def test_file_gets_no_more_bytes_than_were_promised(tmp_path: Path) -> None:
    bus = InProcessBus()
    bus.serve(topics.BLOB, lambda _: BlobReply(size=len(DATA), data=bytes(10**6)))
    with pytest.raises(RunError, match=r"scene\.ply of the run is gone, or has changed"):
        fetch_file(bus, FILE, tmp_path / "scene.ply")
    assert (tmp_path / ".scene.ply.part").stat().st_size <= len(DATA)


def test_pipe_at_the_path_of_a_file_is_not_the_file(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "pipe")
    empty = FileRef(path="pipe", sha256=hashlib.sha256(b"").hexdigest(), size=0)
    assert not blobs.is_whole(tmp_path / "pipe", empty)
    assert not blobs.is_whole(Path("/dev/zero"), empty)
    assert not blobs.is_whole(Path("a\0b"), empty)
