import signal
import threading
from collections.abc import Callable

import pytest

from readygo.apps.fleet import process
from readygo.apps.fleet.process import stop_signal, watch_thread


def test_sigterm_is_the_signal_to_stop(monkeypatch: pytest.MonkeyPatch) -> None:
    handlers: dict[int, Callable[..., object]] = {}
    monkeypatch.setattr(process.signal, "signal", handlers.__setitem__)
    stop = stop_signal(exit_with_parent=False)
    assert list(handlers) == [signal.SIGTERM]
    assert not stop.is_set()
    handlers[signal.SIGTERM](signal.SIGTERM, None)
    assert stop.is_set()


def test_thread_that_hangs_is_noticed_and_one_that_works_is_not() -> None:
    over = threading.Event()
    hanging = threading.Thread(target=over.wait)
    working = threading.Thread(target=lambda: [sum(range(1000)) for _ in iter(over.is_set, True)])
    noticed: dict[str, threading.Event] = {}
    for name, thread, silent_s in (("hanging", hanging, 0.2), ("working", working, 30.0)):
        thread.start()
        noticed[name] = threading.Event()
        watch_thread(thread, silent_s=silent_s, end=noticed[name].set)
    assert noticed["hanging"].wait(20.0)
    assert not noticed["working"].is_set()
    over.set()
    for thread in (hanging, working):
        thread.join()
