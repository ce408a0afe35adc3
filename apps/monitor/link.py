"""The connection to a fleet, with reconnection."""

import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from readygo.apps.fleet.access import TLS, join
from readygo.apps.monitor.watch import RunWatch
from readygo.common.bus.identity import MONITOR
from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.errors import BusError, PeerError, ReadygoError
from readygo.common.messages import RunSpec, RunSpecRequest, topics
from readygo.runs.folder import RunFolder

SILENT_S = 15.0
"""Time without a message after which a coordinator counts as ended or replaced [s]."""
RETRY_S = 2.0
SPEC_TIMEOUT_S = 5.0


class RunAddress(NamedTuple):
    """Endpoint, name and credentials of a run."""

    endpoint: str
    run: str
    token: str
    certs: Path | None = None
    """Folder with a certificate of a monitor, for a tls/ endpoint."""

    def bus(self) -> ZenohBus:
        """Join the run as a monitor; raises as `readygo.apps.fleet.access.join` does."""
        return join(self.endpoint, self.run, MONITOR, certs=self.certs, token=self.token)


def address_of(folder: RunFolder, certs: Path | None = None) -> RunAddress:
    """Address of the fleet that works on a folder.

    Args:
        folder: Folder of the run.
        certs: Folder of certificates, for a fleet with TLS.

    Raises:
        RunError: If no fleet works on the folder.
    """
    endpoint, token = folder.fleet_endpoint()
    return RunAddress(endpoint, folder.load()[0].run, token, certs if endpoint.startswith(TLS) else None)


class Link:
    """Connects a watch to its run, and reconnects it, on a separate thread."""

    def __init__(self, watch: RunWatch, find: Callable[[], RunAddress]) -> None:
        """Prepare a link that is not connected.

        Args:
            watch: Receiver of the run's streams.
            find: Returns the current address; raises RunError while no fleet works on the run.
        """
        self._watch, self._find = watch, find
        self._bus: ZenohBus | None = None
        self._address: RunAddress | None = None
        self._joined_s = 0.0
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._keep, name="link", daemon=True)

    def join(self) -> RunSpec:
        """Join the run now.

        Raises:
            BusError: If no coordinator answers, the token is wrong, or the coordinator has a different version.
            CertificateError: If there is no usable certificate.
            RunError: If no fleet works on the run.
        """
        address = self._find()
        bus = address.bus()
        try:
            spec = _spec(bus, address)
        except BaseException:
            bus.close()
            raise
        self._bus, self._address, self._joined_s = bus, address, time.monotonic()
        with self._watch.lock:
            self._watch.spec, self._watch.connection = spec, ""
        self._watch.join(bus)
        return spec

    def start(self) -> None:
        """Connect, and reconnect each time the run is lost, until `close`."""
        self._thread.start()

    def close(self) -> None:
        """Leave the run."""
        self._stop.set()
        if self._thread.ident is not None:
            self._thread.join()
        self._leave()

    def _keep(self) -> None:
        while not self._stop.is_set():
            if self._bus is not None and self._is_lost():
                self._leave()
            if self._bus is None:
                try:
                    self.join()
                except ReadygoError as error:
                    with self._watch.lock:
                        self._watch.connection = str(error)
            self._stop.wait(RETRY_S)

    def _is_lost(self) -> bool:
        status = self._watch.status
        quiet_s = time.monotonic() - max(self._watch.heard_s, self._joined_s)
        if quiet_s < SILENT_S:
            return False
        over = bool(status and status.finished)
        with self._watch.lock:
            self._watch.connection = "the run is over" if over else f"nothing was heard for {quiet_s:.0f} s"
        return True

    def _leave(self) -> None:
        if self._bus is not None:
            self._watch.leave()
            self._bus.close()
            self._bus = None


def _spec(bus: ZenohBus, address: RunAddress) -> RunSpec:
    """Request the run's spec.

    Raises:
        BusError: If the request fails, with possible causes.
    """
    try:
        return bus.request(topics.SPEC, RunSpecRequest(), timeout_s=SPEC_TIMEOUT_S)
    except PeerError as error:
        raise BusError(
            f"The fleet at {address.endpoint} is of another version of readygo than this monitor: {error}"
        ) from error
    except BusError as error:
        raise BusError(
            f"A router answers at {address.endpoint}, but no run {address.run!r} is there: take the name that "
            "`readygo generate --listen` prints."
        ) from error
