"""What is prepared; that the episodes come out the same is in tests/apps/fleet/test_live.py."""

import dataclasses
from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.common.messages import FileRef, PolicyRef, RunSpec
from readygo.common.messages.stages import DRIVE_LINE
from readygo.runs.again import prepare_again
from readygo.runs.config import RunConfig, resolved_sections
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import BlobStore, Ledger, Written
from readygo.services.coordinator.protocol import Holder
from tests.common.messages.run_specs import SPEC

LIVE = dataclasses.replace(
    SPEC,
    config=resolved_sections(RunConfig()),
    stages=DRIVE_LINE,
    policy=PolicyRef(path="", files=(), mix=0.5),
)


@pytest.fixture
def data(tmp_path: Path) -> Path:
    """A run of four episodes, of which 0 and 2 are durable, the latter driven by the second of two policies."""
    folder = RunFolder(tmp_path / "data")
    with folder.lock():
        folder.save(LIVE, 4)
    ledger, blobs = Ledger(folder.ledger, DRIVE_LINE), BlobStore(folder.blobs)
    offered = [
        ledger.policies.offer(
            PolicyRef(path="", files=(FileRef(path="head", sha256=blobs.put(head), size=1),), mix=0.5), 1
        )
        for head in (b"1", b"2")
    ]
    ledger.open_episodes(4)
    ledger.adopt(0, Written(recorder="rec0", attempt=1, shard="shard", samples=10))
    ledger.adopt(2, Written(recorder="rec0", attempt=1, shard="shard", samples=10, policy=offered[1].sha256))
    ledger.close()
    return folder.path


def _prepared(data: Path, out: Path) -> tuple[RunSpec, int, Ledger]:
    spec, count = prepare_again(data, out)
    return spec, count, Ledger(RunFolder(out).ledger, DRIVE_LINE)


def test_durable_episodes_are_opened_with_their_policies_and_nothing_else(data: Path, tmp_path: Path) -> None:
    spec, count, ledger = _prepared(data, tmp_path / "again")
    assert (spec, count) == (LIVE, 2)
    assert RunFolder(tmp_path / "again").load() == (LIVE, 2)
    assert ledger.open_episodes(2) == 0
    leases = [ledger.claim(DRIVE_LINE[0], Holder(worker="w"), 10.0) for _ in range(3)]
    assert [lease.index for lease in leases if lease] == [0, 2]
    (policy,) = ledger.policies.all()
    assert BlobStore(RunFolder(tmp_path / "again").blobs).get(policy.files[0].sha256) == b"2"
    ledger.close()


def test_folder_that_has_grown_since_is_followed(data: Path, tmp_path: Path) -> None:
    prepare_again(data, tmp_path / "again")
    grown = Ledger(RunFolder(data).ledger, DRIVE_LINE)
    grown.adopt(1, Written(recorder="rec0", attempt=1, shard="shard", samples=10))
    grown.close()
    _, count, ledger = _prepared(data, tmp_path / "again")
    assert count == 3
    assert ledger.census.waiting() == {"human-plan": 3}
    ledger.close()


def test_what_cannot_be_made_again_is_refused_in_words(data: Path, tmp_path: Path) -> None:
    empty = RunFolder(tmp_path / "empty")
    with empty.lock():
        empty.save(LIVE, 4)
    with pytest.raises(RunError, match="holds no durable episodes yet"):
        prepare_again(empty.path, tmp_path / "again")
    for blob in RunFolder(data).blobs.iterdir():
        blob.unlink()
    with pytest.raises(RunError, match="has lost file head of policy"):
        prepare_again(data, tmp_path / "again")
    (tmp_path / "full").mkdir()
    (tmp_path / "full" / "notes.txt").touch()
    with pytest.raises(RunError, match="holds files of something else"):
        prepare_again(data, tmp_path / "full")
