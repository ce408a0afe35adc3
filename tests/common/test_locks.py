import os
import threading
from pathlib import Path

from readygo.common.locks import hold


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
