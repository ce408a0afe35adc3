import os
import queue
import socket
import time
from pathlib import Path

import pytest

from readygo.apps.observe import health
from readygo.common.bus import InProcessBus
from readygo.common.messages import topics
from readygo.common.messages.live import LiveHealth


def test_process_says_how_it_is_while_somebody_listens(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(health, "EVERY_S", 0.01)
    bus = InProcessBus()
    bus.announce("recorder", "rec0")
    heard: queue.SimpleQueue[LiveHealth] = queue.SimpleQueue()
    bus.subscribe(topics.HEALTH.of(), heard.put)
    with health.showing_health(bus, "recorder", "rec0", data=tmp_path, metrics="127.0.0.1:9464"):
        said = heard.get(timeout=10.0)
    assert (said.role, said.name, said.metrics) == ("recorder", "rec0", "127.0.0.1:9464")
    assert 0 < said.disk_free_bytes <= said.disk_size_bytes
    bus.close()


def test_process_without_data_has_no_disk_and_says_what_it_takes() -> None:
    said = health._health("renderer", "r0", None, "")
    assert (said.disk_free_bytes, said.disk_size_bytes, said.pid, said.metrics) == (0, 0, os.getpid(), "")
    assert said.host == socket.gethostname()
    assert 0 < said.cpu_s <= time.process_time()
    assert 0 < said.uptime_s <= time.monotonic()
    assert 1e6 < said.memory_bytes < 1e12
