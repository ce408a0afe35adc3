"""Access of processes to a run's router: by the run's token on this machine, by certificates across networks."""

import contextlib
import logging
import os
import sys
import threading
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

from readygo.apps.fleet.token import given_token
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.bus.identity import COORDINATOR, RECORDER, Identity
from readygo.common.bus.rights import access_control
from readygo.common.bus.zenoh_bus import Router, ZenohBus
from readygo.common.errors import BusError, CertificateError
from readygo.common.extras import install_command
from readygo.common.messages.stages import STAGES

log = logging.getLogger(__name__)

TLS = "tls/"
ROUTER_ABSENT_S = 30.0
"""Time that a worker waits for a router that is not up yet or still refuses its token [s]."""
SPEC_TIMEOUT_S = 30.0
"""Time that a worker or a trainer waits for the coordinator to start [s]."""
_RETRY_S = 0.2


def join(
    connect: str, run: str, role: str, *, name: str = "", certs: Path | None = None, token: str | None = None
) -> ZenohBus:
    """Join a run.

    Args:
        connect: Endpoint of the run's router, tls/HOST:PORT with certificates, tcp/HOST:PORT without.
        run: Name of the run.
        role: Role of the process; with certificates, the role's one is presented.
        name: Name of a recorder, which its certificate contains.
        certs: Folder of certificates.
        token: Token of the run, without certificates; the one of this process's environment by default.

    Raises:
        CertificateError: If endpoint and certificates do not fit together, or the certificate cannot be used.
        BusError: If no router answers, or it refuses.
    """
    identity = identity_for(connect, role, name=name, certs=certs)
    if identity:
        return ZenohBus(connect, run, identity=identity)
    return ZenohBus(connect, run, given_token() if token is None else token)


def join_in_time(
    connect: str, run: str, role: str, stop: threading.Event, *, name: str = "", certs: Path | None = None
) -> ZenohBus:
    """Join a run as `join` does, and wait for a router that is not up yet, for `ROUTER_ABSENT_S` or until `stop`."""
    deadline_s = time.monotonic() + ROUTER_ABSENT_S
    told = False
    while True:
        try:
            return join(connect, run, role, name=name, certs=certs)
        except BusError as error:
            if time.monotonic() > deadline_s or stop.is_set():
                raise
            if not told:
                log.warning("%s Trying again for %g s.", error, ROUTER_ABSENT_S)
            told = True
            stop.wait(_RETRY_S)


def open_router(recorders: Iterable[str], listen: str, *, certs: Path | None, token: str) -> Router:
    """Open a router for runs: with certificates each process has the rights of its role, else it needs the token.

    Args:
        recorders: Names of the runs' recorders.
        listen: Endpoint of the router.
        certs: Folder with the coordinator's certificate.
        token: Secret that all processes must know, without certificates.

    Raises:
        CertificateError: If endpoint and certificates do not fit together, or the certificate cannot be used.
        BusError: If the endpoint cannot be opened.
    """
    identity = identity_for(listen, COORDINATOR, certs=certs)
    if identity is None:
        return Router(listen, token)
    return Router(listen, identity=identity, access=access_control({stage.role for stage in STAGES}, recorders))


def identity_for(endpoint: str, role: str, *, name: str = "", certs: Path | None = None) -> Identity | None:
    """The certificate to present at an endpoint; None for an endpoint without certificates.

    Raises:
        ConfigError: If the endpoint is malformed.
        CertificateError: If endpoint and certificates do not fit together, or the certificate cannot be used.
    """
    check_endpoint(endpoint)
    if endpoint.startswith(TLS) != (certs is not None):
        wrong = "needs certificates: pass --certs" if certs is None else "has no use for certificates: name it tls/..."
        raise CertificateError(f"Endpoint {endpoint} {wrong}.")
    if certs is None:
        return None
    try:
        from readygo.apps.fleet.certificates import load_identity
    except ImportError as error:
        raise CertificateError(f"Certificates need cryptography; run: {install_command('tls')}") from error
    return load_identity(certs, f"{role}.{name}" if role == RECORDER else role)


@contextlib.contextmanager
def refusals_on_stderr() -> Iterator[None]:
    """Make Zenoh log refused connections to standard error, not to standard output, which has the command's results."""
    sys.stdout.flush()
    output = os.dup(1)
    os.dup2(2, 1)
    try:
        yield
    finally:
        os.dup2(output, 1)
        os.close(output)


def how_to_join(state: Path, role: str, endpoint: str, options: str = "", *, certs: Path | None) -> str:
    """How further workers join a run, in a line.

    Args:
        state: Folder of the run's state, which has the token.
        role: Role of the workers.
        endpoint: Endpoint of the run's router.
        options: Further options of their command.
        certs: Folder of certificates; None for a run with a token.
    """
    command = f"readygo worker {role} --connect {endpoint}{options}"
    proof = f"READYGO_TOKEN=$(tail -1 {state / 'endpoint'}) "
    return f"More workers can join: {f'{command} --certs CERTS' if certs else proof + command}"


def reached_here(listen: str) -> str:
    """The endpoint under which this machine reaches its own router that listens on all addresses."""
    return listen.replace("/0.0.0.0:", "/127.0.0.1:").replace("/[::]:", "/[::1]:")
