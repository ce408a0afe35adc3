"""Recording of a run, in one process or by a fleet on this machine or on Slurm's nodes."""

import contextlib
import queue
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from readygo.apps.fleet.access import join, open_router, reached_here, refusals_on_stderr
from readygo.apps.fleet.fleet import Fleet
from readygo.apps.fleet.roles import places
from readygo.apps.fleet.slurm import SlurmWorkers
from readygo.apps.fleet.token import given_token, new_token
from readygo.apps.fleet.worker import make_coordinator, make_recorder
from readygo.apps.observe.observer import ProcessObserver
from readygo.apps.observe.settings import NOTHING, Observing
from readygo.common.bus import Bus, InProcessBus
from readygo.common.bus.identity import COORDINATOR, RECORDER
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.dataset.aside import read_set_aside
from readygo.common.errors import BusError, RunError
from readygo.common.fleet import Worker, claim_any
from readygo.common.fleet.leases import COORDINATOR_ABSENT_S
from readygo.common.messages import ClaimStatus, RunSpec, StatusReply, StatusRequest, topics
from readygo.runs.folder import RunFolder
from readygo.runs.identity import numeric_class
from readygo.runs.recorders import prepare_folders, recorders_of
from readygo.runs.recovery import check_recorded, recover
from readygo.runs.stages import LINE, Entry, stage_works
from readygo.runs.world import World
from readygo.services import coordinator as coordination
from readygo.services.recorder import attach as attach_recorder

LAUNCHER = "launcher"
Show = Callable[[StatusReply], None]
CHECK_S = 0.25
"""Longest time between checks of a fleet's processes [s]."""
EPISODES_MAX = 10_000_000
WORKERS_MAX = 256


def check_counts(episodes: int, workers: int) -> None:
    """Raise RunError if the number of episodes or workers is out of range."""
    if not 1 <= episodes <= EPISODES_MAX:
        raise RunError(f"--episodes must be 1..{EPISODES_MAX}, got {episodes}.")
    if not 0 <= workers <= WORKERS_MAX:
        raise RunError(f"--workers must be 0..{WORKERS_MAX}, got {workers}.")


def record(
    spec: RunSpec,
    out: Path,
    *,
    episodes: int,
    workers: int,
    listen: str = "",
    show: Show = lambda status: None,
    together: bool = False,
    slurm: str | None = None,
    observing: Observing = NOTHING,
    certs: Path | None = None,
) -> dict[str, Any]:
    """Record a run, or the rest of it.

    Args:
        spec: Spec of the run.
        out: Data folder of the run.
        episodes: Number of episodes that the folder shall hold.
        workers: Renderer or driver processes of the fleet; 0 does everything in this process.
        listen: Endpoint of the fleet's router; empty takes a free loopback port.
        show: Called with the run's status periodically.
        together: True for workers that do all stages each.
        slurm: Options of sbatch, for workers that are Slurm jobs and do all stages; None starts them here.
        observing: Metrics and logs of the processes; this one is the launcher.
        certs: Folder of certificates, for an endpoint tls/...

    Returns:
        Summary with counts and times, as plain values.

    Raises:
        RunError: If the run fails; recorded episodes stay.
    """
    check_counts(episodes, workers)
    folder = RunFolder(out)
    folder.check(spec)
    begin_s = time.monotonic()
    with folder.lock():
        # A different run may have begun in the folder since.
        folder.check(spec)
        recover(folder)
        prepare_folders(folder, spec)
        recorded, samples_before = _count_recorded(folder, episodes)
        _save(folder, spec, episodes)
        if workers == 0 or recorded == episodes:
            status = run_in_process(folder, show, observing=observing)
        else:
            endpoint = listen or free_endpoint()
            status = run_fleet(
                folder,
                workers,
                endpoint,
                show,
                together=together,
                slurm=slurm,
                certs=certs,
                observing=observing,
            )
        if status.failed:
            raise RunError(f"{status.failed} ({status.committed} of {status.wanted} episodes are recorded.)")
        check_recorded(folder)
    return _summary(folder, status, samples_before, time.monotonic() - begin_s)


def begin(spec: RunSpec, out: Path, episodes: int) -> None:
    """Prepare a data folder for `lead`: a new run, or the rest of one.

    A paused run stays paused until `readygo resume`: supervisors start the same command again after a crash.

    Raises:
        RunError: If the folder cannot hold the run.
    """
    folder = RunFolder(out)
    folder.check(spec)
    with folder.lock():
        folder.check(spec)
        _count_recorded(folder, episodes)
        folder.save(spec, episodes)


def run_in_process(
    folder: RunFolder, show: Show, line: Sequence[Entry] = LINE, observing: Observing = NOTHING
) -> StatusReply:
    """Do all stages in this process, through the same handlers.

    Args:
        folder: Data folder that holds the run's spec.
        show: Called with the run's status.
        line: Builders of the stages' work functions.
        observing: Metrics and logs of this process.
    """
    with _observer(folder, observing) as observer:
        return _run_in_process(folder, show, line, observer)


def count_recorded(out: Path) -> int:
    """Number of episodes that a data folder holds, once what an interruption left is repaired; 0 for a new folder.

    Raises:
        RunError: If the folder cannot be repaired, or another process records there.
    """
    folder = RunFolder(out)
    if not folder.has_data:
        return 0
    with folder.lock():
        recover(folder)
        return _count_recorded(folder, EPISODES_MAX)[0]


def _observer(folder: RunFolder, observing: Observing) -> ProcessObserver:
    return ProcessObserver(observing, run=folder.load()[0].run, role=LAUNCHER, name=LAUNCHER, state=folder.state)


def _run_in_process(folder: RunFolder, show: Show, line: Sequence[Entry], observer: ProcessObserver) -> StatusReply:
    bus = observer.bus(InProcessBus())
    coordinator = make_coordinator(folder)
    observer.coordinator(coordinator)
    coordination.attach(bus, coordinator)
    world = World(coordinator.spec, bus)
    recorders = [make_recorder(bus, name, folder, world) for name in coordinator.recorders]
    for recorder in recorders:
        attach_recorder(bus, recorder)
    try:
        if not coordinator.over:
            works = observer.works(stage_works(world, bus, line=line))
            _work_until_over(
                bus,
                Worker(
                    name="in-process",
                    numeric_class=numeric_class(world.config, world.spec.policy, world.spec.teacher),
                    works=works,
                ),
                show,
            )
    finally:
        for recorder in recorders:
            recorder.close()
    status = bus.request(topics.STATUS, StatusRequest())
    bus.close()
    coordinator.ledger.close()
    return status


def _work_until_over(bus: Bus, worker: Worker, show: Show) -> None:
    while (status := claim_any(bus, worker)) is not ClaimStatus.DONE:
        run = bus.request(topics.STATUS, StatusRequest())
        if status is ClaimStatus.WAIT and run.trouble:
            raise RunError(f"No stage can work: {run.trouble} Mend that; the same command resumes the run.")
        if status is ClaimStatus.WAIT:
            raise RunError("No stage has work, yet the run is not finished; its ledger is damaged.")
        show(run)


def run_fleet(
    folder: RunFolder,
    workers: int,
    endpoint: str,
    show: Show,
    *,
    together: bool = False,
    slurm: str | None = None,
    observing: Observing = NOTHING,
    certs: Path | None = None,
) -> StatusReply:
    """Record the run with a fleet over Zenoh; arguments as in `record`."""
    spec, _ = folder.load()
    token = "" if certs else given_token() or new_token()
    recorders = recorders_of(folder, spec)
    router = open_router(recorders, endpoint, certs=certs, token=token)
    here, data = reached_here(endpoint), folder.path.resolve()
    fleet = Fleet(
        connect=here, run=spec.run, data=data, logs=folder.logs, token=token, certs=certs, observing=observing
    )
    bus = join(here, spec.run, COORDINATOR, certs=certs, token=token)
    try:
        with (
            folder.reachable(here, token),
            _observer(folder, observing) as observer,
            contextlib.ExitStack() as jobs,
        ):
            observer.launcher(fleet.members)
            if certs:
                jobs.enter_context(refusals_on_stderr())
            members = places(spec, recorders, workers, together=together)
            checks = [fleet.check]
            if slurm is not None:
                members = [(role, name) for role, name in members if role in (COORDINATOR, RECORDER)]
            for role, name in members:
                fleet.add(role, name)
            if slurm is not None:
                array = SlurmWorkers(
                    connect=endpoint, run=spec.run, logs=folder.logs, options=slurm, token=token, certs=certs
                )
                jobs.enter_context(array).submit(workers)
                checks.append(array.check)
            status = _supervise(checks, bus, show)
    finally:
        fleet.stop()
        bus.close()
        router.close()
    if status.finished:
        fleet.check_recorders()
    return status


def _supervise(checks: Sequence[Callable[[], None]], bus: Bus, show: Show) -> StatusReply:
    """Call `checks`, which restart processes, until the coordinator reports the end of the run."""
    heard: queue.SimpleQueue[StatusReply] = queue.SimpleQueue()
    bus.subscribe(topics.PROGRESS, heard.put)
    heard_s = time.monotonic()
    while True:
        try:
            status = heard.get(timeout=CHECK_S)
        except queue.Empty:
            if time.monotonic() - heard_s > COORDINATOR_ABSENT_S:
                raise BusError(f"The coordinator has said nothing for {COORDINATOR_ABSENT_S:g} s.") from None
        else:
            heard_s = time.monotonic()
            show(status)
            if status.finished or status.failed:
                return status
        for check in checks:
            check()


def _save(folder: RunFolder, spec: RunSpec, episodes: int) -> None:
    """Save spec and number of episodes, and clear a pause: a user who starts the run wants it to continue."""
    folder.save(spec, episodes)
    if folder.ledger.exists():
        ledger = coordination.Ledger(folder.ledger)
        ledger.notes.put("paused", "no")
        ledger.close()


def _count_recorded(folder: RunFolder, wanted: int) -> tuple[int, int]:
    """Numbers of the run's durable episodes and their samples; raises RunError if `wanted` is below the episodes."""
    if not folder.ledger.exists():
        return 0, 0
    ledger = coordination.Ledger(folder.ledger)
    (episodes, samples), wanted_min = ledger.census.committed_counts(), ledger.wanted_min()
    ledger.close()
    if wanted_min > wanted:
        raise RunError(
            f"{folder.path} holds {episodes} episodes already, the last one is number {wanted_min} of its run; "
            f"ask for at least {wanted_min} with --episodes."
        )
    return episodes, samples


def _summary(folder: RunFolder, status: StatusReply, samples_before: int, wall_s: float) -> dict[str, Any]:
    return {
        "episodes": status.committed,
        "samples": status.samples,
        "wall_s": round(wall_s, 2),
        "samples_per_s": round((status.samples - samples_before) / wall_s, 1),
        "rejected": status.rejected,
        "kept": status.kept,
        "set_aside": read_set_aside(folder.path),
        "requeued": status.requeued,
        "cpu_s": {stage: round(seconds, 2) for stage, seconds in status.cpu_s.items()},
        "data": str(folder.path),
    }
