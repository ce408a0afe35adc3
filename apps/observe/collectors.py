"""Metrics of coordinator, recorder and launcher about a run, computed at each scrape."""

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Protocol

from readygo.apps.observe.metrics import Gauges
from readygo.common.files import disk_space
from readygo.common.messages import StatusRequest
from readygo.services.coordinator import Coordinator, handle_fleet, handle_status
from readygo.services.recorder import Recorder

Rows = Iterator[tuple[str, str, dict[str, str], float]]


class Restarted(Protocol):
    """A member of a fleet, with its number of restarts."""

    name: str
    restarts: int


def of_coordinator(coordinator: Coordinator) -> Gauges:
    """Metrics of a coordinator: queue, leases, workers and progress."""

    def rows() -> Rows:
        status, fleet = handle_status(coordinator, StatusRequest()), handle_fleet(coordinator)
        stages = [stage.name for stage in coordinator.spec.stages]
        yield "readygo_episodes_wanted", "Episodes that the run shall have", {}, status.wanted
        yield "readygo_episodes_committed", "Durable episodes", {}, status.committed
        yield "readygo_samples_committed", "Samples of durable episodes", {}, status.samples
        yield from _by("stage", "readygo_episodes_waiting", "Episodes that wait", stages, status.waiting)
        yield from _by("stage", "readygo_episodes_leased", "Episodes that a worker holds", stages, status.leased)
        yield "readygo_episodes_rejected", "Indices that a stage rejected", {}, sum(status.rejected.values())
        yield "readygo_episodes_aside", "Episodes that were given up", {}, coordinator.ledger.census.aside()
        yield "readygo_leases_requeued_total", "Leases that ended without a result", {}, status.requeued
        silent_s = max((worker.silent_s for worker in fleet.workers if worker.holds), default=0.0)
        yield "readygo_lease_silent_seconds", "Time since the most silent holder of a lease was heard", {}, silent_s
        roles = sorted({stage.role for stage in coordinator.spec.stages})
        counts: dict[str, float] = {}
        for worker in fleet.workers:
            counts[worker.role] = counts.get(worker.role, 0) + 1
        yield from _by("role", "readygo_workers", "Processes that are there", sorted({*roles, *counts}), counts)
        yield "readygo_run_trouble", "1 while the run waits for a user to mend something", {}, bool(status.trouble)
        yield "readygo_run_paused", "1 while no work is given out", {}, coordinator.paused
        yield "readygo_run_failed", "1 if the run cannot be finished", {}, bool(status.failed)
        yield "readygo_run_finished", "1 when all wanted episodes are durable", {}, status.finished
        yield from _disk(coordinator.ledger.path.parent, {})

    return rows


def of_recorder(recorder: Recorder, labels: Mapping[str, str] | None = None) -> Gauges:
    """Metrics of a recorder: recorded and pending episodes, and its disk; all of them have `labels`."""
    of = dict(labels or {})

    def rows() -> Rows:
        state = recorder.state()
        yield "readygo_recorder_episodes", "Durable episodes in this recorder's shards", of, state.episodes
        yield "readygo_recorder_buffered_episodes", "Episodes that are coming in", of, state.buffered_episodes
        yield "readygo_recorder_buffered_bytes", "Their images so far", of, state.buffered_bytes
        yield "readygo_recorder_refused", "1 while the disk takes nothing", of, bool(state.trouble)
        yield from _disk(recorder.folder, of)

    return rows


def of_launcher(members: Sequence[Restarted]) -> Gauges:
    """Numbers of restarts of a local fleet's processes; `members` may change."""

    def rows() -> Rows:
        for member in members:
            yield "readygo_worker_restarts_total", "Number of restarts", {"member": member.name}, member.restarts

    return rows


def _by(label: str, name: str, words: str, values: list[str], counts: Mapping[str, float]) -> Rows:
    for value in values:
        yield name, words, {label: value}, counts.get(value, 0)


def _disk(folder: Path, labels: dict[str, str]) -> Rows:
    free, total = disk_space(folder)
    yield "readygo_disk_free_bytes", "Room on the disk of this process's data", labels, free
    yield "readygo_disk_size_bytes", "Size of that disk", labels, total
