"""One worker process of a fleet: `readygo worker ROLE`."""

import dataclasses
import logging
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from tyro.conf import Positional

from readygo.apps.cli import USER_MISTAKE
from readygo.apps.fleet.access import SPEC_TIMEOUT_S, join_in_time
from readygo.apps.fleet.process import LATE_S, keep_the_heap_small, stop_signal, watch_thread
from readygo.apps.fleet.runs import ANY_RUN, Runs
from readygo.apps.fleet.several import record_for, work_for
from readygo.apps.observe.health import showing_health
from readygo.apps.observe.logs import begin_logging
from readygo.apps.observe.observer import ProcessObserver
from readygo.apps.observe.settings import Observing
from readygo.common.bus import Bus
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.bus.identity import ALL, COORDINATOR, RECORDER, TRAINER
from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.dataset.provenance import Provenance
from readygo.common.dataset.writer import is_shard_of
from readygo.common.errors import CANNOT_WORK, BusError, ReadygoError, RunError
from readygo.common.fleet import Worker, pull
from readygo.common.messages import RunSpecRequest, topics
from readygo.common.messages.reconstruction import RECONSTRUCTOR
from readygo.common.printable import strip_controls
from readygo.runs.aside import keep_scenario, note_set_aside
from readygo.runs.config import config_of
from readygo.runs.folder import RunFolder
from readygo.runs.identity import check_same_make, files_of, numeric_class
from readygo.runs.policy import check_offer
from readygo.runs.recovery import Witness
from readygo.services import coordinator as coordination
from readygo.services.recorder import Recorder
from readygo.services.recorder import attach as attach_recorder

if TYPE_CHECKING:
    # These modules take a second to load; coordinator and recorder do not need them.
    from readygo.runs.world import World

log = logging.getLogger(__name__)

_OF_ONE_RUN = (COORDINATOR, TRAINER, RECONSTRUCTOR)
SETTLE_S = 0.5
"""Period in which the recorder repeats reports that the coordinator has not acknowledged [s]."""
TICK_S = 0.2
"""Period in which the coordinator frees expired leases and publishes the run's status [s]."""


@dataclass(frozen=True, kw_only=True)
class WorkerOptions:
    """Join a fleet as one worker, until the run is finished or SIGTERM; work that has begun is finished first.

    Files of the run that the machine lacks (scene, avatars, policy) are fetched, checked and cached for all its
    workers.

    Without `run`, or with several, the worker serves one run at a time: the one with the highest priority that has
    work.

    Exit status 78 means that a user must mend something first (settings, data, disk); a restart does not help. Without
    certificates, the environment variable READYGO_TOKEN must hold the run's token.
    """

    role: Positional[str]
    """coordinator, recorder, the role of a stage (human-planner, animator, robot-planner, renderer or driver),
    all, which does every stage in one process, trainer, or reconstructor."""
    connect: str
    """Endpoint of the fleet's router, such as tcp/127.0.0.1:7447 or tls/lab1:7447."""
    run: str = ""
    """Name of the run, as `readygo generate --listen` or `readygo reconstruct --listen` prints it, or several
    separated by commas; by default a recorder or a stage's worker serves all present and future runs of the
    router."""
    name: str = ""
    """Name of this worker; must differ between workers of one role."""
    data: tuple[Path, ...] = ()
    """Data folder of the run, for coordinator and recorder; a trainer catches up from it, with one folder per run.
    A recorder of several runs makes a folder for each run in it."""
    out: Path | None = None
    """Folder of the policy (trainer only)."""
    config: Path | None = None
    """TOML file with fields of `TrainConfig` that override the recipe's (trainer only)."""
    certs: Path | None = None
    """Folder of certificates; the worker presents its role's to a tls/ endpoint."""
    exit_with_parent: bool = False
    """Exit as soon as standard input is closed."""
    observe: Observing = field(default_factory=Observing)


def worker(options: WorkerOptions) -> None:
    """Join a fleet as one worker, until the run is finished or SIGTERM; work that has begun is finished first."""
    check_endpoint(options.connect, "--connect")
    if options.role != TRAINER:
        keep_the_heap_small()
    stop = stop_signal(options.exit_with_parent)
    watch_thread(threading.main_thread())
    name = options.name or f"{options.role}-{socket.gethostname()}-{os.getpid()}"
    begin_logging(options.observe.log_format, run=options.run, role=options.role, worker=name)
    try:
        joined = partial(join_in_time, options.connect, role=options.role, stop=stop, certs=options.certs)
        several = options.role not in _OF_ONE_RUN and (not options.run or "," in options.run)
        if not options.run and not several:
            raise RunError(f"A {options.role} needs the name of its run: pass --run.")
        state = RunFolder(options.data[0]).state if options.data and not several else None
        with ProcessObserver(options.observe, run=options.run, role=options.role, name=name, state=state) as observer:
            if options.role == TRAINER:
                buses: dict[str, Bus] = {each: joined(each) for each in options.run.split(",")}
                _train(buses, options.data, options.out, options.config, stop)
            elif options.role == RECONSTRUCTOR:
                _reconstruct(joined(options.run), name, stop, observer)
            else:
                part = _Part(options.role, name, options.data, observer, partial(joined, name=name), stop)
                if several:
                    _serve_runs(part, [each for each in options.run.split(",") if each])
                else:
                    _take_part(part, options.run, stop.is_set, alone=not options.exit_with_parent)
    except BusError as error:
        if options.observe.log_format == "text":
            raise
        log.critical("%s", error)
        raise SystemExit(USER_MISTAKE) from error
    except ReadygoError as error:
        if options.observe.log_format == "text":
            sys.stderr.write(f"readygo: {strip_controls(str(error))}\n")
        else:
            log.critical("%s", error)
        raise SystemExit(CANNOT_WORK) from error


@dataclass(frozen=True)
class _Part:
    """Role, name and connections of a process in a fleet."""

    role: str
    name: str
    data: tuple[Path, ...]
    observer: ProcessObserver
    join: Callable[[str], ZenohBus]
    """Joins the bus of a run by its name."""
    stop: threading.Event
    """Ends the process when it is set."""


def _serve_runs(part: _Part, named: list[str]) -> None:
    """Take part in the named runs, or in all runs of the router."""
    folder = _folder(part.role, part.data).path if part.role == RECORDER else None
    if folder is None:
        # Compile kernels before a run waits for this worker.
        from readygo.runs.warm import warm_once

        warm_once()
    bus = part.join(ANY_RUN)
    try:
        runs = Runs(bus, role=part.role, me=part.name, named=named)

        def take_part(run: str, leave: Callable[[], bool]) -> bool:
            own = dataclasses.replace(part, data=(folder / run,)) if folder else part
            return _take_part(own, run, leave, alone=True)

        serve = record_for if folder else work_for
        serve(runs, take_part, part.stop)
    finally:
        bus.close()


def _take_part(part: _Part, run: str, leave: Callable[[], bool], *, alone: bool) -> bool:
    """Do a role's work in a run until `leave`, or until the run is over; returns True if it is over.

    `alone` is True for a process without a supervisor on this machine.
    """
    role, observer = part.role, part.observer
    disk = part.data[0] if part.data and role in (COORDINATOR, RECORDER) else None
    bus = observer.bus(part.join(run))
    try:
        with showing_health(bus, role, part.name, data=disk, metrics=observer.metrics_at):
            if role == COORDINATOR:
                return _coordinate(bus, _folder(role, part.data), part.stop, observer)
            if role == RECORDER:
                return _record(bus, part.name, _folder(role, part.data), part.stop, observer, alone=alone)
            return _work(bus, role, part.name, leave, observer, alone=alone)
    finally:
        bus.close()


def _reconstruct(bus: Bus, name: str, stop: threading.Event, observer: ProcessObserver) -> None:
    # Imported here: it takes memory that no other role needs.
    from readygo.services.reconstructor import pull_jobs

    try:
        with showing_health(bus, RECONSTRUCTOR, name, metrics=observer.metrics_at):
            pull_jobs(observer.bus(bus), name, stop)
    finally:
        bus.close()


def _train(
    buses: dict[str, Bus], data: tuple[Path, ...], out: Path | None, config: Path | None, stop: threading.Event
) -> None:
    from readygo.apps.fleet.trainer import train_beside
    from readygo.runs.training import make_config

    try:
        if out is None:
            raise RunError("A trainer needs a folder for its policy: pass --out.")
        train_beside(dict(buses), make_config("best", config), out, data=data, stop=stop)
    finally:
        for bus in buses.values():
            bus.close()


def make_coordinator(folder: RunFolder, *, recorded_here: bool = True) -> coordination.Coordinator:
    """The coordinator of the run in a data folder.

    Args:
        folder: Folder of the run.
        recorded_here: False if recorders write to other machines' disks, which this process cannot read.
    """
    spec, wanted = folder.load()
    config = config_of(spec)
    witness = Witness(folder)
    ledger = coordination.Ledger(folder.ledger, spec.stages)
    note_set_aside(folder, ledger.census.set_aside())

    def set_aside(index: int, reason: str, results: Mapping[str, bytes]) -> str:
        note_set_aside(folder, ledger.census.set_aside())
        return keep_scenario(folder, index, reason, results)

    return coordination.Coordinator(
        spec=spec,
        wanted=wanted,
        ledger=ledger,
        blobs=coordination.BlobStore(folder.blobs, files_of(spec)),
        config=config.coordinator,
        check_policy=partial(check_offer, config=config),
        holds=lambda report: (
            witness.holds_episode(report.recorder, report.shard, report.index)
            if recorded_here
            else is_shard_of(report.shard, report.recorder)
        ),
        set_aside=set_aside,
    )


def take_the_lead(bus: Bus, coordinator: coordination.Coordinator) -> Callable[[], None]:
    """Announce this coordinator before it answers: two coordinators of one run would lease its episodes twice.

    Returns:
        A check to call before each tick. It raises RunError if this process was cut off, another coordinator has taken
        the lead meanwhile, and both are reachable now. The later one keeps the lead: by the clocks, and by the count of
        leaders in the ledger, which copies of the folder share.

    Raises:
        BusError: If another process leads the run, in any folder.
    """
    run, replaced = coordinator.spec.run, threading.Event()
    turn = coordinator.ledger.notes.next_turn(time.time_ns())

    def lead_on() -> None:
        if replaced.is_set():
            raise RunError(
                f"Run {run} is led by a coordinator that was started later, while this one was cut off: this one "
                f"stops. What it knows ({coordinator.ledger.path}) is out of date; continue in the other one's folder."
            )

    try:
        bus.announce(COORDINATOR, COORDINATOR, turn=turn, replaced=replaced.set)
    except BusError as error:
        raise BusError(
            f"Run {run} is led already by another coordinator at this router, maybe in a copy of its folder: stop that "
            "one, or, for a second run of the same scene and settings, choose another --seed."
        ) from error
    return lead_on


def make_recorder(bus: Bus, name: str, folder: RunFolder, world: "World") -> Recorder:
    """Make a recorder that writes to the run's data folder."""
    return Recorder(
        folder=folder.place_of(name),
        name=name,
        bus=bus,
        provenance=Provenance.of_run(world.spec),
        config=world.config.recorder,
        stage=world.stage(),
    )


def _coordinate(bus: Bus, folder: RunFolder, stop: threading.Event, observer: ProcessObserver) -> bool:
    with folder.lock_coordinator(patience_s=2 * LATE_S):
        coordinator = make_coordinator(folder)
        observer.coordinator(coordinator)
        lead_on = take_the_lead(bus, coordinator)
        coordination.attach(bus, coordinator)
        while not stop.wait(TICK_S):
            lead_on()
            coordination.tick(bus, coordinator)
        return coordinator.over


def _record(
    bus: Bus, name: str, folder: RunFolder, stop: threading.Event, observer: ProcessObserver, *, alone: bool
) -> bool:
    over = threading.Event()
    if alone:
        bus.subscribe(topics.PROGRESS, lambda status: over.set() if status.finished or status.failed else None)
    world = _world(bus, RECORDER)
    recorder = make_recorder(bus, name, folder, world)
    forget = observer.recorder(recorder, world.spec.run)
    try:
        # First: a second recorder of the name is refused before it answers for the grants of the other one.
        bus.announce(RECORDER, name)
        attach_recorder(bus, recorder)
        while not (over.is_set() or stop.wait(SETTLE_S)):
            recorder.settle()
        recorder.close()
    finally:
        forget()
        recorder.leave()
    return over.is_set()


def _work(bus: Bus, role: str, name: str, leave: Callable[[], bool], observer: ProcessObserver, *, alone: bool) -> bool:
    from readygo.runs.stages import stage_works
    from readygo.runs.warm import warm_once

    world = _world(bus, role)
    if alone:
        check_same_make(world.spec, world.config)
        warm_once()
    works = observer.works(stage_works(world, bus, "" if role == ALL else role))
    world.forget_avatars()
    session = bus.announce(role, name)
    numeric = numeric_class(world.config, world.spec.policy, world.spec.teacher)
    me = Worker(name=name, numeric_class=numeric, works=works, role=role, session=session)
    return pull(bus, me, leave=leave)


def _world(bus: Bus, role: str) -> "World":
    from readygo.runs.world import World

    return World(bus.request(topics.SPEC, RunSpecRequest(role=role), timeout_s=SPEC_TIMEOUT_S), bus)


def _folder(role: str, data: tuple[Path, ...]) -> RunFolder:
    if len(data) != 1:
        raise RunError(f"A {role} needs the run's data folder: pass --data.")
    return RunFolder(data[0])
