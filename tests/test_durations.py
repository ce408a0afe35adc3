from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tests.durations import Durations, load_durations, sort_longest_first


def item(nodeid: str, *, slow: bool = False) -> Any:
    return SimpleNamespace(nodeid=nodeid, get_closest_marker=lambda name: name if slow else None)


def test_longest_file_is_first_and_its_tests_keep_their_order() -> None:
    items = [
        item("short.py::b"),
        item("long.py::z"),
        item("long.py::a"),
        item("new.py::c"),
        item("marked.py::d", slow=True),
    ]
    sort_longest_first(items, {"short.py": 2.0, "long.py": 70.0})
    assert [each.nodeid for each in items] == ["long.py::z", "long.py::a", "marked.py::d", "short.py::b", "new.py::c"]


def test_file_of_few_tests_is_first_where_nothing_was_measured() -> None:
    items = [item("many.py::a"), item("many.py::b"), item("one.py::c")]
    sort_longest_first(items, {})
    assert [each.nodeid for each in items] == ["one.py::c", "many.py::a", "many.py::b"]


def test_times_of_a_run_are_stored_beside_those_of_other_files(tmp_path: Path) -> None:
    path = tmp_path / "durations.json"
    path.write_text('{"old.py": 7.0, "faster.py": 9.0}')
    plugin = Durations(path)
    for nodeid, duration in (("new.py::a", 1.25), ("new.py::b", 3.0), ("faster.py::a", 0.1)):
        plugin.pytest_runtest_logreport(
            pytest.TestReport(nodeid, ("", 0, ""), {}, "passed", None, "call", duration=duration)
        )
    plugin.pytest_sessionfinish()
    assert load_durations(path) == {"new.py": 4.2, "old.py": 7.0}


def test_nothing_is_known_before_the_first_run(tmp_path: Path) -> None:
    assert load_durations(tmp_path / "none.json") == {}
