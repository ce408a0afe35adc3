"""`readygo status`, `pause`, `resume` and `cancel`: a run that a fleet is at work on."""

import json as json_module
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path

from readygo.apps.fleet.token import given_token
from readygo.apps.run.folder import RunFolder
from readygo.common.bus import Bus
from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.config import section_to_mapping
from readygo.common.errors import RunError
from readygo.common.messages import Command, ControlRequest, StatusReply, StatusRequest, topics


def status(data: Path | None = None, /, *, connect: str = "", run: str = "", json: bool = False) -> None:
    """Say how far a run is.

    Args:
        data: Data folder that a fleet of this machine is recording into.
        connect: Endpoint of the fleet's router, in place of the folder.
        run: Name of the run there, as `readygo generate --listen` prints it.
        json: Print all numbers as JSON.
    """
    with _joined(data, connect, run) as bus:
        reply = bus.request(topics.STATUS, StatusRequest())
    sys.stdout.write((json_module.dumps(section_to_mapping(reply)) if json else status_text(reply)) + "\n")


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


def status_text(reply: StatusReply) -> str:
    """How far a run is, in a few lines."""
    lines = [f"{reply.committed} of {reply.wanted} episodes, {reply.samples} samples"]
    counts = {"waiting": reply.waiting, "at work": reply.leased, "rejected": reply.rejected, "kept": reply.kept}
    lines += [f"  {name}: {_listed(count)}" for name, count in counts.items() if count]
    lines += [f"  policies offered: {reply.policies}"] if reply.policies else []
    lines += [f"  waits: {reply.trouble}"] if reply.trouble else []
    lines += [f"  ended: {reply.failed}"] if reply.failed else []
    return "\n".join(lines)


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {name}" for name, count in counts.items())


def _send(command: Command, data: Path | None, connect: str, run: str) -> None:
    with _joined(data, connect, run) as bus:
        bus.request(topics.CONTROL, ControlRequest(command=command))


@contextmanager
def _joined(data: Path | None, connect: str, run: str) -> Iterator[Bus]:
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
