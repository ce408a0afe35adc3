from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.services.coordinator import Ledger
from readygo.services.coordinator.database import Database

ADD = "INSERT INTO run VALUES (?, ?)"


@pytest.fixture
def database(tmp_path: Path) -> Database:
    return Database(tmp_path / "ledger.sqlite")


def test_statements_give_rows_one_row_or_a_number(database: Database) -> None:
    assert database.one("SELECT * FROM run") is None
    with database.together():
        database.run_each(ADD, [("a", "1"), ("b", "2")])
    assert database.all("SELECT value FROM run ORDER BY key") == [("1",), ("2",)]
    assert database.one("SELECT key FROM run WHERE value = ?", "2") == ("b",)
    assert database.count("SELECT count(*) FROM run") == 2
    assert [database.has_row("SELECT 1 FROM run WHERE key = ?", key) for key in "bc"] == [True, False]


def test_what_is_done_together_is_done_whole_or_not_at_all(database: Database) -> None:
    def fail_in_the_middle() -> None:
        with database.together():
            database.run(ADD, "first", "1")
            with database.together():
                database.run(ADD, "second", "2")
            raise KeyError

    with pytest.raises(KeyError):
        fail_in_the_middle()
    assert database.all("SELECT * FROM run") == []
    with database.together():
        database.run(ADD, "first", "1")
        with database.together():
            database.run(ADD, "second", "2")
    assert database.count("SELECT count(*) FROM run") == 2


def test_damaged_ledger_is_found(tmp_path: Path) -> None:
    path = tmp_path / "ledger.sqlite"
    ledger = Ledger(path)
    ledger.open_episodes(3000)
    ledger.check()
    ledger.close()
    data = bytearray(path.read_bytes())
    data[8192:20000] = bytes(20000 - 8192)
    path.write_bytes(data)
    with pytest.raises(RunError, match=r"ledger\.sqlite"):
        Ledger(path).check()


def test_file_that_is_no_ledger_is_said_in_one_line(tmp_path: Path) -> None:
    (tmp_path / "ledger.sqlite").write_bytes(b"something else " * 100)
    with pytest.raises(RunError, match=r"ledger\.sqlite cannot be used: file is not a database"):
        Ledger(tmp_path / "ledger.sqlite")


def test_full_disk_is_said_in_one_line_and_undoes_the_step(tmp_path: Path) -> None:
    ledger = Ledger(tmp_path / "ledger.sqlite")
    ledger.open_episodes(3)
    (pages,) = ledger._database.one("PRAGMA page_count") or (0,)
    ledger._database.run(f"PRAGMA max_page_count = {pages}")
    with pytest.raises(RunError, match="database or disk is full; if the disk is full, free some space"):
        ledger.open_episodes(10_000)
    assert ledger.census.waiting() == {"human-plan": 3}
    ledger.close()


def test_text_that_is_none_is_damage(database: Database) -> None:
    database.run("CREATE TABLE IF NOT EXISTS words (word TEXT)")
    database.run("INSERT INTO words VALUES (CAST(x'88ff' AS TEXT))")
    with pytest.raises(RunError, match="cannot be used"):
        database.all("SELECT word FROM words")
