from typing import Any

import pytest

from readygo.apps.observe.bus import WatchedBus
from readygo.apps.observe.metrics import Metrics
from readygo.common.bus import InProcessBus
from readygo.common.messages import Command, ControlRequest, Verdict, VerdictStatus, topics

pytest.importorskip("prometheus_client", reason="prometheus-client (the extra `metrics`) is not installed")


def test_requests_are_measured_on_both_sides() -> None:
    metrics = Metrics()
    heard: list[Any] = []
    bus = WatchedBus(InProcessBus(), metrics, lambda request, reply: heard.append((request.command, reply.status)))
    bus.serve(topics.CONTROL, lambda request: Verdict(status=VerdictStatus.OK))
    assert bus.request(topics.CONTROL, ControlRequest(command=Command.PAUSE)).status is VerdictStatus.OK
    for name in ("readygo_request_seconds_count", "readygo_handle_seconds_count"):
        assert metrics.registry.get_sample_value(name, {"topic": "ctl"}) == 1.0
    assert heard == [(Command.PAUSE, VerdictStatus.OK)]
    bus.close()
