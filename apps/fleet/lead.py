"""The coordinator of a run whose workers and recorders are on other machines: router, ledger and blobs."""

import contextlib
import logging
import threading
import time
from collections.abc import Callable
from pathlib import Path

from readygo.apps.fleet.access import join, open_router, reached_here
from readygo.apps.fleet.process import LATE_S
from readygo.apps.fleet.token import given_token, new_token
from readygo.apps.fleet.worker import TICK_S, make_coordinator, take_the_lead
from readygo.apps.observe.health import showing_health
from readygo.apps.observe.observer import Observer
from readygo.apps.observe.settings import NOTHING
from readygo.apps.run.folder import RunFolder
from readygo.apps.run.identity import check_version
from readygo.apps.run.recorders import prepare_folders, recorders_of
from readygo.apps.run.recovery import recover
from readygo.common.bus import Bus, Member
from readygo.common.bus.identity import COORDINATOR
from readygo.common.errors import RunError
from readygo.common.messages import StatusReply, StatusRequest
from readygo.services import coordinator as coordination

log = logging.getLogger(__name__)

FAREWELL_S = 30.0
"""Time for workers and recorders to learn that the run is over, and to finish their shards [s]."""


def lead(
    folder: RunFolder,
    endpoint: str,
    *,
    joins: bool = False,
    certs: Path | None = None,
    observer: Observer | None = None,
) -> StatusReply:
    """Coordinate the run in a data folder until it is over and all workers have left.

    Args:
        folder: Folder of the run; it holds only the shards of recorders that write there.
        endpoint: Endpoint of the run's router.
        joins: True joins a running router, which several runs may share; False opens one.
        certs: Folder of certificates, for a tls/ endpoint.
        observer: Metrics and logs of this process.

    Raises:
        RunError: If another process works on the folder, the run is of another version, its ledger is lost, it cannot
            be finished, or another coordinator has taken the lead while this one was cut off.
        CertificateError: If the certificates cannot be used.
        BusError: If the endpoint cannot be opened, no router answers there, or another coordinator leads the run there.
    """
    spec, _ = folder.load()
    check_version(spec)
    token = "" if certs else given_token() or ("" if joins else new_token())
    here = endpoint if joins else reached_here(endpoint)
    watched = observer or Observer(NOTHING, run=spec.run, role=COORDINATOR, name=COORDINATOR)
    with folder.locked(), folder.coordinated(patience_s=2 * LATE_S):
        if folder.load()[0].run != spec.run:
            raise RunError(f"Another run was begun in {folder.path} at the same time; choose another --out.")
        recover(folder, recorded_here=False)
        with contextlib.ExitStack() as opened:
            # The router first: if the endpoint cannot be used, the folder stays unlocked.
            if not joins:
                recorders = recorders_of(folder, spec)
                opened.callback(open_router(recorders, endpoint, certs=certs, token=token).close)
            # The ledger is closed after the bus, whose handlers use it.
            ledger = opened.enter_context(contextlib.ExitStack())
            bus = watched.bus(join(here, spec.run, COORDINATOR, certs=certs, token=token))
            opened.callback(bus.close)
            prepare_folders(folder, spec)
            coordinator = make_coordinator(folder, recorded_here=False)
            ledger.callback(coordinator.ledger.close)
            watched.coordinator(coordinator)
            lead_on = take_the_lead(bus, coordinator)
            opened.enter_context(folder.reachable(here, token))
            health = showing_health(bus, COORDINATOR, COORDINATOR, data=folder.path, metrics=watched.metrics_at)
            opened.enter_context(health)
            folder.elsewhere.touch()
            return _until_over(bus, coordinator, lead_on)


def _until_over(bus: Bus, coordinator: coordination.Coordinator, lead_on: Callable[[], None]) -> StatusReply:
    present: set[Member] = set()

    def changed(member: Member, alive: bool) -> None:
        log.info("%s %s %s", member.role, member.name, "has joined" if alive else "has left")
        (present.add if alive else present.discard)(member)

    coordination.attach(bus, coordinator)
    bus.watch(changed)
    over_s = 0.0
    clock = threading.Event()
    while not over_s or (len(present) > 1 and time.monotonic() - over_s < FAREWELL_S):
        clock.wait(TICK_S)
        lead_on()
        coordination.tick(bus, coordinator)
        if coordinator.over and not over_s:
            over_s = time.monotonic()
    status = coordination.handle_status(coordinator, StatusRequest())
    if status.failed:
        raise RunError(f"{status.failed} ({status.committed} of {status.wanted} episodes are recorded.)")
    return status
