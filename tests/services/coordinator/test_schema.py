import sqlite3
from pathlib import Path

import pytest

from readygo.common.messages import FileRef, PolicyRef, Stage, VerdictStatus
from readygo.services.coordinator import Holder, Ledger, Written
from readygo.services.coordinator.schema import open_database

FILM = Stage(name="film", role="camera", records=True)
POLICY = PolicyRef(path="", files=(FileRef(path="head", sha256="a" * 64, size=1),), mix=0.5)


def _columns(path: Path) -> set[str]:
    database = open_database(path)
    columns = {row[1] for row in database.execute("PRAGMA table_info(episode)")}
    database.close()
    return columns


def _strip(path: Path) -> None:
    """Make the file one of before there were policies."""
    database = sqlite3.connect(path)
    for column in ("policy", "driven_by", "assigned"):
        database.execute(f"ALTER TABLE episode DROP COLUMN {column}")
    database.execute("DROP TABLE policy")
    database.close()


def test_ledger_of_before_there_were_policies_goes_on(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    ledger = Ledger(path, (FILM,))
    ledger.open_episodes(2)
    ledger.adopt(1, Written(recorder="rec0", attempt=1, shard="shard", samples=10))
    ledger.close()
    whole = _columns(path)
    _strip(path)
    again = Ledger(path, (FILM,))
    assert again.census.driven_by() == {1: ""}
    offered = again.policies.offer(POLICY, 1)
    lease = again.claim(FILM, Holder(worker="w"), 10.0, "rec0")
    assert lease is not None
    assert (lease.index, lease.policy) == (0, offered.sha256)
    assert again.grant(0, lease.attempt, "rec0") is VerdictStatus.OK
    again.close()
    assert _columns(path) == whole


def test_file_that_is_no_ledger_is_no_database(tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite").write_bytes(b"not a database, whatever its name says" * 40)
    with pytest.raises(sqlite3.Error):
        open_database(tmp_path / "ledger.sqlite")
