"""Collection by several workers at once, each of which imports all test modules.

Pytest rewrites the assertions of a module, which takes twice as long as all else, and keeps the byte code. Each worker
begins elsewhere, and so finds what the others have rewritten.
"""

import gc
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import pytest

from tests.durations import file_of


class TurnedFolder(pytest.Dir):
    """A folder of tests; worker k of n begins at k/n of what is in it."""

    def collect(self) -> Sequence[pytest.Item | pytest.Collector]:
        worker = self.config.workerinput  # type: ignore[attr-defined]
        return turned(list(super().collect()), int(worker["workerid"].removeprefix("gw")), worker["workercount"])


def turned(entries: list[Any], number: int, count: int) -> list[Any]:
    """The entries from the one at `number / count` of the list on, then those before it."""
    first = len(entries) * number // count
    return entries[first:] + entries[:first]


def sort_by_file(items: list[pytest.Item]) -> None:
    """Undo the turn: all workers must have the same order; the tests of a file keep theirs."""
    items.sort(key=lambda item: file_of(item.nodeid))


@contextmanager
def garbage_left_alone() -> Iterator[None]:
    """Look for no garbage meanwhile, and later not among what was made: modules and tests live to the end."""
    gc.disable()
    try:
        yield
    finally:
        gc.freeze()
        gc.enable()
