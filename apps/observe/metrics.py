"""Metrics of a process for Prometheus; `docs/observing.md` lists the names.

Prometheus' client library holds the numbers. It is an extra that only processes with `--metrics` need; others import
and count nothing.
"""

import contextlib
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any

import readygo
from readygo.apps.observe.settings import address
from readygo.common.errors import BusError, ConfigError
from readygo.common.extras import install_command

SECONDS = (0.0005, 0.001, 0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 30.0)
"""Bounds of the buckets of requests [s]."""
STAGE_SECONDS = (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 60.0, 180.0, 600.0)
"""Bounds of the buckets of stages and episodes [s]."""

Gauges = Callable[[], Iterator[tuple[str, str, dict[str, str], float]]]
"""Yields name, help, labels and value of metrics at each scrape; names that end in "_total" are counters."""


class Metrics:
    """The registry of one process and the page that shows it."""

    def __init__(self) -> None:
        """Begin to count.

        Raises:
            ConfigError: If prometheus-client is not installed.
        """
        try:
            import prometheus_client
            import prometheus_client.core
        except ImportError as error:
            raise ConfigError(f"--metrics needs prometheus-client; run: {install_command('metrics')}") from error
        self._client = prometheus_client
        self.registry = prometheus_client.CollectorRegistry()
        prometheus_client.ProcessCollector(registry=self.registry)
        self._requests = self._histogram("readygo_request_seconds", "Time until a request was answered", "topic")
        self._failures = self._counter("readygo_request_failures", "Requests that failed or were refused", "topic")
        self._handled = self._histogram("readygo_handle_seconds", "Time that handling a request took", "topic")
        self._stages = prometheus_client.Histogram(
            "readygo_stage_seconds",
            "Time that a stage of an episode took",
            ["stage", "outcome"],
            buckets=STAGE_SECONDS,
            registry=self.registry,
        )
        self._episodes = prometheus_client.Histogram(
            "readygo_episode_seconds",
            "Time from the first lease of an episode until it was durable",
            buckets=STAGE_SECONDS,
            registry=self.registry,
        )
        self._cpu = self._counter("readygo_stage_cpu_seconds", "Processor time of stages", "stage")
        self.look_up(_of_process)

    def look_up(self, gauges: Gauges) -> Callable[[], None]:
        """Add the metrics of `gauges`, which is called at each scrape; returns a function that removes them."""
        collector = _LookUp(self._client, gauges)
        self.registry.register(collector)
        return partial(self.registry.unregister, collector)

    @contextlib.contextmanager
    def requesting(self, topic: str) -> Iterator[None]:
        """Measure the duration of a request that this process sends."""
        begin_s = time.perf_counter()
        try:
            yield
        except BusError:
            self._failures.labels(topic).inc()
            raise
        finally:
            self._requests.labels(topic).observe(time.perf_counter() - begin_s)

    @contextlib.contextmanager
    def handling(self, topic: str) -> Iterator[None]:
        """Measure the duration of a request that this process handles."""
        begin_s = time.perf_counter()
        try:
            yield
        finally:
            self._handled.labels(topic).observe(time.perf_counter() - begin_s)

    def stage_done(self, stage: str, outcome: str, wall_s: float, cpu_s: float) -> None:
        """Count a stage of an episode: done, rejected or failed."""
        self._stages.labels(stage, outcome).observe(wall_s)
        self._cpu.labels(stage).inc(cpu_s)

    def episode_done(self, wall_s: float) -> None:
        """Count an episode that is durable."""
        self._episodes.observe(wall_s)

    def serve(self, where: str) -> tuple[str, Callable[[], None]]:
        """Serve the metrics at HOST:PORT.

        Returns:
            The endpoint, with the chosen port for port 0, and a function that stops the server.

        Raises:
            ConfigError: If the endpoint cannot be opened.
        """
        host, port = address(where)
        try:
            server, thread = self._client.start_http_server(port, addr=host, registry=self.registry)
        except OSError as error:
            raise ConfigError(f"--metrics cannot listen on {where}: {error.strerror or error}.") from error

        def end() -> None:
            server.shutdown()
            server.server_close()
            thread.join()

        return f"{host}:{server.server_port}", end

    def _histogram(self, name: str, words: str, *labels: str) -> Any:
        return self._client.Histogram(name, words, labels, buckets=SECONDS, registry=self.registry)

    def _counter(self, name: str, words: str, *labels: str) -> Any:
        return self._client.Counter(name, words, labels, registry=self.registry)


class _LookUp:
    """A collector of the client's registry."""

    def __init__(self, client: Any, gauges: Gauges) -> None:
        self._client, self._gauges = client, gauges

    def collect(self) -> Iterator[Any]:
        """Metric families with their current values."""
        core = self._client.core
        families: dict[str, Any] = {}
        for name, words, labels, value in self._gauges():
            kind = core.CounterMetricFamily if name.endswith("_total") else core.GaugeMetricFamily
            family = families.setdefault(name, kind(name, words, labels=list(labels)))
            family.add_metric(list(labels.values()), value)
        yield from families.values()

    def describe(self) -> list[Any]:
        """Empty list: the names are known only after computing all values."""
        return []


def private_bytes() -> int:
    """Private memory of this process [bytes]; 0 if the system does not report it."""
    with contextlib.suppress(OSError):
        lines = Path("/proc/self/smaps_rollup").read_text().splitlines()
        return sum(1024 * int(line.split()[1]) for line in lines if line.startswith("Private_"))
    return 0


def _of_process() -> Iterator[tuple[str, str, dict[str, str], float]]:
    yield "readygo_build_info", "Version of readygo", {"version": readygo.__version__}, 1.0
    yield "readygo_memory_private_bytes", "Memory that this process alone holds", {}, private_bytes()
