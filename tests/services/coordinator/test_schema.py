import contextlib
import sqlite3
from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.common.messages import Stage
from readygo.services.coordinator import Ledger
from readygo.services.coordinator.schema import open_database

FILM = Stage(name="film", role="camera", records=True)


def test_ledger_of_another_layout_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    Ledger(path, (FILM,)).close()
    with contextlib.closing(sqlite3.connect(path)) as database:
        database.execute("PRAGMA user_version = 7")
    with pytest.raises(RunError, match="its layout is number 7, this version of readygo reads 1"):
        Ledger(path, (FILM,))


def test_file_that_is_no_ledger_is_no_database(tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite").write_bytes(b"not a database, whatever its name says" * 40)
    with pytest.raises(sqlite3.Error):
        open_database(tmp_path / "ledger.sqlite")
