"""Seconds of each test file, `durations.json`: workers begin with the longest, so that none of them ends last."""

import json
from collections import Counter
from pathlib import Path

import pytest

STORED = Path(__file__).with_suffix(".json")
LEAST_S = 0.5
"""Shorter files are not stored."""
SLOW_S = 60.0
"""Of one test that is marked as slow, in a file that was not measured."""


def file_of(nodeid: str) -> str:
    """Path of a test's file, from the project's root."""
    return nodeid.partition("::")[0]


def load_durations(path: Path = STORED) -> dict[str, float]:
    """Seconds by file; nothing if they were never stored."""
    return dict(json.loads(path.read_text())) if path.exists() else {}


def sort_longest_first(items: list[pytest.Item], seconds: dict[str, float]) -> None:
    """Order files by their time; the tests of a file keep their order.

    Files that were not measured: first those with tests that are marked as slow, then those of the fewest tests. A file
    of many tests at the end keeps no worker waiting.
    """
    guesses, counts = Counter[str](), Counter(file_of(item.nodeid) for item in items)
    for item in items:
        guesses[file_of(item.nodeid)] += SLOW_S if item.get_closest_marker("slow") else 0.0

    def rank(item: pytest.Item) -> tuple[float, int, str]:
        file = file_of(item.nodeid)
        return -seconds.get(file, guesses[file]), counts[file], file

    items.sort(key=rank)


class Durations:
    """A plugin that stores how long each file took in this run; files that did not run keep their time."""

    def __init__(self, path: Path = STORED) -> None:
        self._path = path
        self._seconds = Counter[str]()

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self._seconds[file_of(report.nodeid)] += report.duration

    def pytest_sessionfinish(self) -> None:
        merged = load_durations(self._path) | {file: round(spent, 1) for file, spent in self._seconds.items()}
        kept = {file: spent for file, spent in sorted(merged.items()) if spent >= LEAST_S}
        self._path.write_text(json.dumps(kept, indent=0) + "\n")
