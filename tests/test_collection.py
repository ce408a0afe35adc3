import gc
from types import SimpleNamespace
from typing import Any

import pytest

from tests.collection import TurnedFolder, garbage_left_alone, sort_by_file, turned


def test_workers_begin_at_parts_of_the_list_and_collect_all_of_it() -> None:
    assert [turned(list("abcdefg"), number, 3) for number in range(3)] == [
        list("abcdefg"),
        list("cdefgab"),
        list("efgabcd"),
    ]
    assert turned([], 1, 3) == []


def test_files_are_in_one_order_and_their_tests_keep_theirs() -> None:
    items: list[Any] = [SimpleNamespace(nodeid=nodeid) for nodeid in ("b.py::z", "b.py::a", "a.py::y", "a.py::x")]
    sort_by_file(items)
    assert [item.nodeid for item in items] == ["a.py::y", "a.py::x", "b.py::z", "b.py::a"]


def test_folder_is_collected_from_where_the_worker_begins(
    request: pytest.FixtureRequest, tmp_path: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("test_a.py", "test_b.py", "test_c.py"):
        (tmp_path / name).touch()
    worker = {"workerid": "gw1", "workercount": 3}
    monkeypatch.setattr(request.config, "workerinput", worker, raising=False)
    folder = TurnedFolder.from_parent(request.session, path=tmp_path)
    assert [entry.name for entry in folder.collect()] == ["test_b.py", "test_c.py", "test_a.py"]


def test_garbage_is_collected_again_afterwards_but_not_what_was_made_meanwhile() -> None:
    with garbage_left_alone():
        assert not gc.isenabled()
    assert gc.isenabled()
    assert gc.get_freeze_count() > 0
