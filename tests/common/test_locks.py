import fcntl
import math
import os
import threading
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.common import locks
from readygo.common.errors import RunError
from readygo.common.locks import held, hold


def test_one_at_a_time_holds_a_file(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    first = hold(path)
    assert first is not None
    assert hold(path) is None
    os.close(first)
    second = hold(path)
    assert second is not None
    os.close(second)


def test_who_waits_gets_it_as_soon_as_it_is_free_even_if_the_file_is_removed(tmp_path: Path) -> None:
    path = tmp_path / "lock"
    first = hold(path)
    assert first is not None

    def leave() -> None:
        path.unlink()
        os.close(first)

    threading.Timer(0.2, leave).start()
    second = hold(path, patience_s=30.0)
    assert second is not None
    assert path.exists()
    assert hold(path) is None
    os.close(second)


def test_patience_ends_after_its_time_and_not_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [100.0]
    tries: list[float] = []

    def sleep(seconds: float) -> None:
        tries.append(now_s[0])
        now_s[0] += 0.25

    monkeypatch.setattr(locks, "time", SimpleNamespace(monotonic=lambda: now_s[0], sleep=sleep))
    first = hold(tmp_path / "lock")
    assert first is not None
    assert hold(tmp_path / "lock") is None
    assert tries == []
    assert hold(tmp_path / "lock", patience_s=0.5) is None
    assert tries == [100.0, 100.25]
    before = len(os.listdir("/proc/self/fd"))
    assert hold(tmp_path / "lock", patience_s=5.0) is None
    assert len(os.listdir("/proc/self/fd")) == before, "nothing stays open"
    os.close(first)


def test_file_that_was_replaced_while_it_was_taken_is_taken_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, answers = tmp_path / "lock", iter([False, False, True])
    monkeypatch.setattr(locks, "_is_still", lambda path, descriptor: next(answers))
    held = hold(path)
    assert held is not None
    assert next(answers, None) is None
    os.close(held)


def test_lock_is_held_while_the_context_is_active_and_its_folder_is_made(tmp_path: Path) -> None:
    path = tmp_path / "a" / "b" / "lock"
    with held(path) as first:
        assert first is not None
        with held(path) as second:
            assert second is None
        assert hold(path) is None
    third = hold(path)
    assert third is not None
    threading.Timer(0.2, os.close, [third]).start()
    with held(path, patience_s=math.inf) as fourth:
        assert fourth is not None


def test_file_that_cannot_be_made_or_locked_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match=r"file cannot be written: File exists\.$"), held(tmp_path / "file" / "lock"):
        pass

    def fail(descriptor: int, operation: int) -> None:
        raise OSError(37, "No locks available")

    before = len(os.listdir("/proc/self/fd"))
    monkeypatch.setattr(fcntl, "flock", fail)
    with pytest.raises(RunError, match=r"cannot be written: No locks available\.$"), held(tmp_path / "lock"):
        pass
    assert len(os.listdir("/proc/self/fd")) == before, "nothing stays open"
