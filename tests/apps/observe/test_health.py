import queue
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
