"""Metrics of one process, by wrappers around its bus and its work functions."""

import contextlib
import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from readygo.apps.observe.bus import WatchedBus
from readygo.apps.observe.collectors import Restarted, of_coordinator, of_launcher, of_recorder
from readygo.apps.observe.episodes import EpisodeClock
from readygo.apps.observe.metrics import Gauges, Metrics
from readygo.apps.observe.settings import Observing
from readygo.common.bus import Bus
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.fleet import Inputs, StageResult, Work
from readygo.common.messages import ClaimReply, Stage
from readygo.runs.folder import TARGETS, keep_private
from readygo.services.coordinator import Coordinator
from readygo.services.recorder import Recorder

log = logging.getLogger(__name__)


class ProcessObserver:
    """Metrics of a process; without them it returns its arguments unchanged."""

    def __init__(self, observing: Observing, *, run: str, role: str, name: str, state: Path | None = None) -> None:
        """Start the metrics.

        Args:
            observing: Requested metrics and logs.
            run: Name of the run.
            role: Role of the process.
            name: Name of the process.
            state: The run's state folder, for a file with the metrics' endpoint.

        Raises:
            ConfigError: If the metrics cannot be started.
        """
        self._run = run
        self._target: Path | None = None
        self._ends: list[Callable[[], None]] = []
        self._metrics = Metrics() if observing.metrics else None
        self.metrics_at = ""
        """Endpoint of the metrics, HOST:PORT; empty without metrics."""
        if self._metrics:
            self.metrics_at, end = self._metrics.serve(observing.metrics)
            self._ends.append(end)
            log.info("metrics at http://%s/metrics", self.metrics_at)
            if state is not None:
                self._announce(state / TARGETS / f"{name}.json", {"run": run, "service": role, "worker": name})

    def __enter__(self) -> "ProcessObserver":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def bus(self, bus: Bus) -> Bus:
        """The bus with observed requests."""
        if self._metrics is None:
            return bus
        return WatchedBus(bus, self._metrics, EpisodeClock(self._metrics.episode_done).observe_reply)

    def works(self, works: Mapping[Stage, Work]) -> Mapping[Stage, Work]:
        """A worker's work functions with measured stages."""
        if self._metrics is None:
            return works
        return {stage: _measure_work(self._metrics, stage, work) for stage, work in works.items()}

    def coordinator(self, coordinator: Coordinator) -> None:
        """Add the metrics of a coordinator."""
        self._look_up(of_coordinator(coordinator))

    def recorder(self, recorder: Recorder, run: str) -> Callable[[], None]:
        """Add the metrics of a recorder, with the label `run` in a process of several runs.

        Returns:
            A function that removes them.
        """
        return self._look_up(of_recorder(recorder, {} if run == self._run else {"run": run}))

    def launcher(self, members: Sequence[Restarted]) -> None:
        """Add the metrics of a local fleet's processes."""
        self._look_up(of_launcher(members))

    def close(self) -> None:
        """Stop the metrics."""
        if self._target is not None:
            self._target.unlink(missing_ok=True)
        while self._ends:
            self._ends.pop()()

    def _look_up(self, gauges: Gauges) -> Callable[[], None]:
        return self._metrics.look_up(gauges) if self._metrics else lambda: None

    def _announce(self, target: Path, labels: dict[str, str]) -> None:
        with contextlib.suppress(RunError):
            write_whole(target, json.dumps([{"targets": [self.metrics_at], "labels": labels}]), raises=RunError)
            keep_private(target.parents[1])
            self._target = target


def _measure_work(metrics: Metrics, stage: Stage, work: Work) -> Work:
    def measure(claim: ClaimReply, inputs: Inputs) -> StageResult | None:
        begin_s, begin_cpu_s, outcome = time.perf_counter(), time.thread_time(), "failed"
        try:
            result = work(claim, inputs)
            outcome = "rejected" if result and result.rejected else "done"
            return result
        finally:
            wall_s, cpu_s = time.perf_counter() - begin_s, time.thread_time() - begin_cpu_s
            metrics.stage_done(stage.name, outcome, wall_s, cpu_s)

    return measure
