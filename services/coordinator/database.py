"""The ledger's file: statements, transactions, and what is said when the disk takes nothing."""

import sqlite3
import threading
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from readygo.common.errors import DiskError, RunError
from readygo.services.coordinator.schema import open_database

_DISK_CODES = (
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_BUSY,
)


class Database:
    """One SQLite file; safe to use from several threads."""

    def __init__(self, path: Path) -> None:
        """Open the file, or make it.

        Raises:
            RunError: If it is no ledger or cannot be written; so do all other methods.
        """
        self.path = path
        self.lock = threading.RLock()
        """Held during a read of several statements, so that no other thread writes between them."""
        try:
            self._connection = open_database(path)
        except (sqlite3.Error, UnicodeDecodeError) as error:
            raise self._error_for(error) from error

    def close(self) -> None:
        """Close the file."""
        self._connection.close()

    def check(self) -> None:
        """Raise RunError if the file is damaged."""
        row = self.one("PRAGMA quick_check(1)")
        if row != ("ok",):
            raise RunError(f"The run's ledger {self.path} is damaged: {row and row[0]}.")

    @contextmanager
    def together(self) -> Iterator[None]:
        """Do what the block does in one transaction, all of it or nothing: each costs more than what it writes."""
        with self.lock:
            if self._connection.in_transaction:
                yield
                return
            try:
                with self._connection:
                    self._connection.execute("BEGIN IMMEDIATE")
                    yield
            except sqlite3.Error as error:
                raise self._error_for(error) from error

    def run(self, statement: str, *values: object) -> None:
        """Run a statement that gives nothing."""
        self.all(statement, *values)

    def run_each(self, statement: str, rows: Iterable[tuple[object, ...]]) -> None:
        """Run a statement with each of several rows of values; within `together`."""
        self._connection.executemany(statement, rows)

    def has_row(self, statement: str, *values: object) -> bool:
        """True if a statement gives a row."""
        return self.one(statement, *values) is not None

    def count(self, statement: str, *values: object) -> int:
        """The number that a statement always gives."""
        row = self.one(statement, *values)
        assert row is not None
        return int(row[0])

    def one(self, statement: str, *values: object) -> tuple[Any, ...] | None:
        """The first row that a statement gives, if it gives one."""
        rows = self.all(statement, *values)
        return rows[0] if rows else None

    def all(self, statement: str, *values: object) -> list[tuple[Any, ...]]:
        """The rows that a statement gives."""
        with self.lock:
            try:
                return self._connection.execute(statement, values).fetchall()
            except (sqlite3.Error, UnicodeDecodeError) as error:
                raise self._error_for(error) from error

    def _error_for(self, error: Exception) -> RunError:
        # The lower byte of an extended code is the plain one.
        later = getattr(error, "sqlite_errorcode", 0) & 0xFF in _DISK_CODES
        return (DiskError if later else RunError)(
            f"The run's ledger {self.path} cannot be used: {error}; if the disk is full, free some space and run "
            "the same command again, else record into a new folder."
        )
