import socket
import urllib.request
from types import SimpleNamespace

import pytest

from readygo.apps.observe import metrics as module
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


def test_times_are_those_between_begin_and_end(monkeypatch: pytest.MonkeyPatch) -> None:
    times_s = iter([10.0, 10.75, 20.0, 22.5])
    monkeypatch.setattr(module, "time", SimpleNamespace(perf_counter=lambda: next(times_s)))
    metrics = Metrics()
    with metrics.requesting("blob"):
        pass
    with metrics.handling("ctl"):
        pass
    metrics.stage_done("render", "done", 3.5, 1.25)
    metrics.stage_done("render", "done", 0.5, 0.5)
    metrics.episode_done(42.0)
    value = metrics.registry.get_sample_value
    assert value("readygo_request_seconds_sum", {"topic": "blob"}) == 0.75
    assert value("readygo_request_failures_total", {"topic": "blob"}) is None
    assert value("readygo_handle_seconds_sum", {"topic": "ctl"}) == 2.5
    assert value("readygo_stage_seconds_sum", {"stage": "render", "outcome": "done"}) == 4.0
    assert value("readygo_stage_cpu_seconds_total", {"stage": "render"}) == 1.75
    assert (value("readygo_episode_seconds_count"), value("readygo_episode_seconds_sum")) == (1.0, 42.0)


def test_what_is_looked_up_is_on_the_page_until_it_ends() -> None:
    metrics = Metrics()
    metrics.look_up(
        lambda: iter(
            [("a_total", "Counts", {"x": "1"}, 3), ("b", "Gauge", {}, 2.5), ("a_total", "Counts", {"x": "2"}, 4)]
        )
    )
    where, end = metrics.serve("127.0.0.1:0")
    page = urllib.request.urlopen(f"http://{where}/metrics").read().decode()
    end()
    lines = page.splitlines()
    for line in ("# TYPE a_total counter", 'a_total{x="1"} 3.0', 'a_total{x="2"} 4.0', "# TYPE b gauge", "b 2.5"):
        assert line in lines, line
    with pytest.raises(OSError, match="refused"):
        urllib.request.urlopen(f"http://{where}/metrics")
