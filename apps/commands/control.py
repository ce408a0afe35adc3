"""`readygo pause`, `resume` and `cancel`: a run that a fleet is at work on."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from readygo.apps.fleet.access import join
from readygo.apps.fleet.runs import none_such, runs_at
from readygo.apps.fleet.token import given_token
from readygo.apps.run.folder import RunFolder
from readygo.common.bus import Bus
from readygo.common.bus.identity import MONITOR, OPERATOR
from readygo.common.errors import BusError, PeerError, RunError
from readygo.common.messages import Command, ControlRequest, topics


def pause(data: Path | None = None, /, *, connect: str = "", run: str = "", certs: Path | None = None) -> None:
    """Give out no more work until `readygo resume`; what is under way is finished.

    Args:
        data: Data folder that a fleet of this machine is recording into.
        connect: Endpoint of the fleet's router, in place of the folder.
        run: Name of the run there, as `readygo generate --listen` prints it.
        certs: Folder with a certificate of an operator, for a tls/ endpoint.
    """
    _send(Command.PAUSE, data, connect, run, certs)


def resume(data: Path | None = None, /, *, connect: str = "", run: str = "", certs: Path | None = None) -> None:
    """Give out work again after `readygo pause`.

    Args:
        data: Data folder that a fleet of this machine is recording into.
        connect: Endpoint of the fleet's router, in place of the folder.
        run: Name of the run there, as `readygo generate --listen` prints it.
        certs: Folder with a certificate of an operator, for a tls/ endpoint.
    """
    _send(Command.RESUME, data, connect, run, certs)


def cancel(data: Path | None = None, /, *, connect: str = "", run: str = "", certs: Path | None = None) -> None:
    """End a run; what is recorded stays, and `readygo generate` goes on with it.

    Args:
        data: Data folder that a fleet of this machine is recording into.
        connect: Endpoint of the fleet's router, in place of the folder.
        run: Name of the run there, as `readygo generate --listen` prints it.
        certs: Folder with a certificate of an operator, for a tls/ endpoint.
    """
    _send(Command.CANCEL, data, connect, run, certs)


def _send(command: Command, data: Path | None, connect: str, run: str, certs: Path | None) -> None:
    with joined(data, connect, run, certs) as bus:
        bus.request(topics.CONTROL, ControlRequest(command=command))


@contextmanager
def joined(data: Path | None, connect: str, run: str, certs: Path | None) -> Iterator[Bus]:
    """The bus of a run that is named by its data folder, or by endpoint and name.

    Raises:
        RunError: If it is not named, or no fleet is at work on it.
        BusError: If nobody answers there.
    """
    token = given_token()
    if data is not None:
        folder = RunFolder(data)
        (connect, token), run = folder.fleet_endpoint(), folder.load()[0].run
    if not connect or not run:
        raise RunError("Name the run: its data folder, or --connect ENDPOINT --run RUN.")
    bus = join(connect, run, shown_role(certs), certs=certs, token=token)
    try:
        yield bus
    except PeerError:
        raise
    except BusError as error:
        there = runs_at(connect, shown_role(certs), certs=certs, token=token)
        raise BusError(none_such(run, connect, there)) from error
    finally:
        bus.close()


def shown_role(certs: Path | None) -> str:
    """The certificate of a folder that somebody who looks at a run shows: an operator's, or else a monitor's."""
    monitors = certs is not None and not (certs / f"{OPERATOR}.pem").exists() and (certs / f"{MONITOR}.pem").exists()
    return MONITOR if monitors else OPERATOR
