import socket

import pytest

from readygo.apps.observe.metrics import Metrics, private_bytes
from readygo.common.errors import BusError, ConfigError

client = pytest.importorskip("prometheus_client", reason="prometheus-client (the extra `metrics`) is not installed")


def test_request_that_failed_is_measured_and_counted() -> None:
    metrics = Metrics()
    with pytest.raises(BusError), metrics.requesting("blob"):
        raise BusError("nobody")
    value = metrics.registry.get_sample_value
    assert value("readygo_request_failures_total", {"topic": "blob"}) == 1.0
    assert value("readygo_request_seconds_count", {"topic": "blob"}) == 1.0


def test_port_in_use_is_said_in_one_line() -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        with pytest.raises(ConfigError, match=r"--metrics cannot listen on 127\.0\.0\.1"):
            Metrics().serve(f"127.0.0.1:{taken.getsockname()[1]}")


def test_memory_of_its_own_is_less_than_all() -> None:
    assert 1e6 < private_bytes() < 1e12
