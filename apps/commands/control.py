"""`readygo pause`, `resume` and `cancel`: a run that a fleet is at work on."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from readygo.apps.fleet.token import given_token
from readygo.apps.run.folder import RunFolder
from readygo.common.bus import Bus
from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.errors import RunError
from readygo.common.messages import Command, ControlRequest, topics


def pause(data: Path | None = None, /, *, connect: str = "", run: str = "") -> None:
    """Give out no more work until `readygo resume`; what is under way is finished.

    Args:
        data: Data folder that a fleet of this machine is recording into.
        connect: Endpoint of the fleet's router, in place of the folder.
        run: Name of the run there, as `readygo generate --listen` prints it.
    """
    _send(Command.PAUSE, data, connect, run)


def resume(data: Path | None = None, /, *, connect: str = "", run: str = "") -> None:
    """Give out work again after `readygo pause`.

    Args:
        data: Data folder that a fleet of this machine is recording into.
        connect: Endpoint of the fleet's router, in place of the folder.
        run: Name of the run there, as `readygo generate --listen` prints it.
    """
    _send(Command.RESUME, data, connect, run)


def cancel(data: Path | None = None, /, *, connect: str = "", run: str = "") -> None:
    """End a run; what is recorded stays, and `readygo generate` goes on with it.

    Args:
        data: Data folder that a fleet of this machine is recording into.
        connect: Endpoint of the fleet's router, in place of the folder.
        run: Name of the run there, as `readygo generate --listen` prints it.
    """
    _send(Command.CANCEL, data, connect, run)


def _send(command: Command, data: Path | None, connect: str, run: str) -> None:
    with joined(data, connect, run) as bus:
        bus.request(topics.CONTROL, ControlRequest(command=command))


@contextmanager
def joined(data: Path | None, connect: str, run: str) -> Iterator[Bus]:
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
    bus = ZenohBus(connect, run, token)
    try:
        yield bus
    finally:
        bus.close()
