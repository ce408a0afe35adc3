import hashlib

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.errors import RunError
from readygo.common.fleet import fetch_blob
from readygo.common.messages import BlobReply, BlobRequest, topics

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
