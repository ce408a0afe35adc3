"""What one process shows of itself, as it was asked for: its bus and its work are watched, and nothing else knows."""

import contextlib
import json
import logging
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

from readygo.apps.observe.bus import WatchedBus, Watcher
from readygo.apps.observe.collectors import Restarted, of_coordinator, of_launcher, of_recorder
from readygo.apps.observe.episodes import EpisodeClock
from readygo.apps.observe.metrics import Gauges, Metrics
from readygo.apps.observe.settings import Observing
from readygo.apps.observe.traces import Traces
from readygo.apps.run.folder import TARGETS, keep_private
from readygo.common.bus import Bus
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.common.fleet import Inputs, StageResult, Work
from readygo.common.fleet.at_work import AtWork
from readygo.common.messages import ClaimReply, Stage
from readygo.services.coordinator import Coordinator
from readygo.services.recorder import Recorder

log = logging.getLogger(__name__)


class Observer:
    """Metrics and traces of a process; without any, what it is given it gives back."""

    def __init__(self, observing: Observing, *, run: str, role: str, name: str, state: Path | None = None) -> None:
        """Begin to watch.

        Args:
            observing: What is asked for.
            run: Name of the run.
            role: What the process does.
            name: Its name.
            state: The run's state folder, to say there where the metrics are.

        Raises:
            ConfigError: If something cannot be shown.
        """
        self._target: Path | None = None
        self._ends: list[Callable[[], None]] = []
        self._metrics = Metrics() if observing.metrics else None
        self._traces = Traces(observing.traces, run=run, role=role, worker=name) if observing.traces else None
        self.metrics_at = ""
        """Where the metrics are, HOST:PORT; empty if nowhere."""
        if self._traces:
            self._ends.append(self._traces.close)
        if self._metrics:
            self.metrics_at, end = self._metrics.serve(observing.metrics)
            self._ends.append(end)
            log.info("metrics at http://%s/metrics", self.metrics_at)
            if state is not None:
                self._announce(state / TARGETS / f"{name}.json", {"run": run, "service": role, "worker": name})

    def __enter__(self) -> "Observer":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def bus(self, bus: Bus) -> Bus:
        """The bus, watched."""
        watchers: list[Watcher] = [watcher for watcher in (self._metrics, self._traces) if watcher is not None]
        return WatchedBus(bus, tuple(watchers), EpisodeClock(self._episode_done).answered) if watchers else bus

    def works(self, works: Mapping[Stage, Work]) -> Mapping[Stage, Work]:
        """A worker's works, watched."""
        if self._metrics is None and self._traces is None:
            return works
        return {stage: self._watched(stage, work) for stage, work in works.items()}

    def coordinator(self, coordinator: Coordinator) -> None:
        """Show the queue."""
        self._look_up(of_coordinator(coordinator))

    def recorder(self, recorder: Recorder) -> None:
        """Show a recorder."""
        self._look_up(of_recorder(recorder))

    def launcher(self, members: Sequence[Restarted]) -> None:
        """Show how the processes of a fleet fare."""
        self._look_up(of_launcher(members))

    def close(self) -> None:
        """Show nothing any more."""
        if self._target is not None:
            self._target.unlink(missing_ok=True)
        while self._ends:
            self._ends.pop()()

    def _look_up(self, gauges: Gauges) -> None:
        if self._metrics:
            self._metrics.look_up(gauges)

    def _announce(self, target: Path, labels: dict[str, str]) -> None:
        with contextlib.suppress(RunError):
            write_whole(target, json.dumps([{"targets": [self.metrics_at], "labels": labels}]), raises=RunError)
            keep_private(target.parents[1])
            self._target = target

    def _episode_done(self, episode: str, begin_ns: int, end_ns: int, attempt: int, samples: int) -> None:
        if self._metrics:
            self._metrics.episode_done((end_ns - begin_ns) / 1e9)
        if self._traces:
            attributes = {"readygo.attempt": attempt, "readygo.samples": samples}
            self._traces.episode(episode, begin_ns, end_ns, attributes)

    def _watched(self, stage: Stage, work: Work) -> Work:
        def watched(claim: ClaimReply, inputs: Inputs) -> StageResult | None:
            assert claim.episode is not None
            at_work = AtWork(stage=stage.name, episode=claim.episode.episode_id, attempt=claim.attempt)
            begin_s, begin_cpu_s, outcome = time.perf_counter(), time.thread_time(), "failed"
            try:
                with self._traces.stage(at_work) if self._traces else contextlib.nullcontext():
                    result = work(claim, inputs)
                outcome = "rejected" if result and result.rejected else "done"
                return result
            finally:
                if self._metrics:
                    wall_s, cpu_s = time.perf_counter() - begin_s, time.thread_time() - begin_cpu_s
                    self._metrics.stage_done(stage.name, outcome, wall_s, cpu_s)

        return watched
