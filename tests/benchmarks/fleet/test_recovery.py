import os
import subprocess
import sys
import threading
import time
from types import SimpleNamespace

import pytest

from readygo.benchmarks.fleet import recovery
from readygo.common.bus import InProcessBus

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


def test_start_of_a_process_is_read() -> None:
    assert 0.0 < time.monotonic() - recovery._started_s(os.getpid()) < 24 * 3600


def test_watch_hears_who_comes_and_gives_up_in_time(monkeypatch: pytest.MonkeyPatch) -> None:
    bus = InProcessBus()
    watch = recovery.RunObserver(bus)
    threading.Timer(0.05, lambda: bus.announce("renderer", "r0")).start()
    begin_s = time.monotonic()
    assert watch.until(lambda: "r0" in watch.came_s) >= begin_s
    monkeypatch.setattr(recovery, "PATIENCE_S", 0.05)
    with pytest.raises(TimeoutError):
        watch.until(lambda: watch.committed_s > 0.0)


def test_successor_is_ready_when_it_came_however_long_the_end_of_a_lease_was_waited_for(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(recovery, "LEASELESS_S", 2.0)
    with subprocess.Popen(["sleep", "60"]) as first, subprocess.Popen(["sleep", "60"]) as second:
        try:
            bus = InProcessBus()
            watch = recovery.RunObserver(bus)
            there = iter([first.pid, second.pid])
            site = SimpleNamespace(processes=lambda: {"animator0": next(there)})
            threading.Timer(0.1, lambda: bus.announce("animator", "animator0")).start()
            threading.Timer(2.5, lambda: watch._committed(None)).start()
            begin_s = time.monotonic()
            rows = recovery._kill(site, watch, "animator0")
            assert time.monotonic() - begin_s > 2.0
            assert rows["ready: animator"] < 2.0 + begin_s - recovery._started_s(second.pid)
        finally:
            first.kill()
            second.kill()


def test_rows_stand_beside_what_is_asked() -> None:
    rows = {
        "recorder kill -> commit": {"best": 1.25, "median": 2.5, "count": 3},
        "ready: renderer, processor time": {"best": 1.0, "median": 1.0, "count": 3},
    }
    text = recovery._text({"repeats": 3, "load": 0.5, "machine": {"cores": 2}, "rows": rows})
    assert text.splitlines()[2].split() == ["recorder", "kill", "->", "commit", "1.25", "2.50", "3.0"]
    assert text.splitlines()[3].split()[-1] == "1.00"
