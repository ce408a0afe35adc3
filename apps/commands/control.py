"""`readygo pause`, `resume` and `cancel`: control of a run that a fleet is working on."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.fleet.access import join
from readygo.apps.fleet.options import JoinOptions
from readygo.apps.fleet.runs import none_such, runs_at
from readygo.apps.fleet.token import given_token
from readygo.common.bus import Bus
from readygo.common.bus.identity import MONITOR, OPERATOR
from readygo.common.errors import BusError, PeerError, RunError
from readygo.common.messages import Command, ControlRequest, topics
from readygo.runs.folder import RunFolder


@dataclass(frozen=True, kw_only=True)
class ControlOptions:
    """Pause a run: workers finish their current work and get no more until `readygo resume`."""

    data: Positional[Path | None] = None
    """Data folder that a fleet on this machine is recording into."""
    fleet: JoinOptions = field(default_factory=JoinOptions)


def pause(options: ControlOptions) -> None:
    """Pause a run: workers finish their current work and get no more until `readygo resume`."""
    _send(Command.PAUSE, options.data, options.fleet.connect, options.fleet.run, options.fleet.certs)


def resume(options: ControlOptions) -> None:
    """Resume a run after `readygo pause`: workers get work again."""
    _send(Command.RESUME, options.data, options.fleet.connect, options.fleet.run, options.fleet.certs)


def cancel(options: ControlOptions) -> None:
    """End a run; recorded episodes stay, and `readygo generate` can resume it."""
    _send(Command.CANCEL, options.data, options.fleet.connect, options.fleet.run, options.fleet.certs)


def _send(command: Command, data: Path | None, connect: str, run: str, certs: Path | None) -> None:
    with join_run(data, connect, run, certs) as bus:
        bus.request(topics.CONTROL, ControlRequest(command=command))


@contextmanager
def join_run(data: Path | None, connect: str, run: str, certs: Path | None) -> Iterator[Bus]:
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
