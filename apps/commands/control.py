"""`readygo pause`, `resume` and `cancel`: control of a run that a fleet is working on."""

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
    """Pause a run: workers finish their current work and get no more until `readygo resume`.

    Args:
        data: Data folder that a fleet on this machine is recording into.
        connect: Endpoint of the fleet's router, instead of the folder.
        run: Name of the run, as `readygo generate --listen` prints it.
        certs: Folder with an operator's certificate, for a tls/ endpoint.
    """
    _send(Command.PAUSE, data, connect, run, certs)


def resume(data: Path | None = None, /, *, connect: str = "", run: str = "", certs: Path | None = None) -> None:
    """Resume a run after `readygo pause`: workers get work again.

    Args:
        data: Data folder that a fleet on this machine is recording into.
        connect: Endpoint of the fleet's router, instead of the folder.
        run: Name of the run, as `readygo generate --listen` prints it.
        certs: Folder with an operator's certificate, for a tls/ endpoint.
    """
    _send(Command.RESUME, data, connect, run, certs)


def cancel(data: Path | None = None, /, *, connect: str = "", run: str = "", certs: Path | None = None) -> None:
    """End a run; recorded episodes stay, and `readygo generate` can resume it.

    Args:
        data: Data folder that a fleet on this machine is recording into.
        connect: Endpoint of the fleet's router, instead of the folder.
        run: Name of the run, as `readygo generate --listen` prints it.
        certs: Folder with an operator's certificate, for a tls/ endpoint.
    """
    _send(Command.CANCEL, data, connect, run, certs)


def _send(command: Command, data: Path | None, connect: str, run: str, certs: Path | None) -> None:
    with joined(data, connect, run, certs) as bus:
        bus.request(topics.CONTROL, ControlRequest(command=command))


@contextmanager
def joined(data: Path | None, connect: str, run: str, certs: Path | None) -> Iterator[Bus]:
    """Join the bus of a run, named by its data folder or by endpoint and run name.

    Raises:
        RunError: If the run is not named, or no fleet is working on it.
        BusError: If no coordinator answers at the endpoint.
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
    """The role whose certificate a client presents: operator, or monitor if the folder holds only a monitor's."""
    monitors = certs is not None and not (certs / f"{OPERATOR}.pem").exists() and (certs / f"{MONITOR}.pem").exists()
    return MONITOR if monitors else OPERATOR
