"""`readygo status`: the progress of a run, and its workers."""

import json as json_module
import sys
import time
from pathlib import Path

from rich.live import Live

from readygo.apps.commands.control import joined, shown_role
from readygo.apps.fleet.access import join
from readygo.apps.fleet.runs import ANY_RUN, HEAR_S, Runs
from readygo.apps.observe.status import Look, Observed, runs_table, status_table
from readygo.apps.terminal import PlainConsole
from readygo.common.config import section_to_mapping

REFRESH_S = 1.0
LISTEN_S = 1.5
"""Time in which every process reports its use of the machine once [s]."""


def status(
    data: Path | None = None,
    /,
    *,
    connect: str = "",
    run: str = "",
    certs: Path | None = None,
    watch: bool = False,
    json: bool = False,
) -> None:
    """Show the progress of a run: the queue of every stage, rates, remaining time, workers with their leases, disks.

    With only `connect` it lists the runs of a router, highest priority first.

    Args:
        data: Data folder that a fleet on this machine is recording into.
        connect: Endpoint of the fleet's router, instead of the folder.
        run: Name of the run, as `readygo generate --listen` prints it; without it all runs are listed.
        certs: Folder with a certificate of a monitor or an operator, for a tls/ endpoint.
        watch: Refresh until the run is finished, or Ctrl-C.
        json: Print all numbers as JSON.
    """
    if data is None and connect and not run:
        _list(connect, certs, watch=watch, json=json)
        return
    with joined(data, connect, run, certs) as bus:
        look = Look(bus)
        if json:
            observed = look.now()
            plain = {**section_to_mapping(observed.status), "fleet": section_to_mapping(observed.fleet)}
            sys.stdout.write(json_module.dumps(plain) + "\n")
            return
        time.sleep(LISTEN_S)
        console = PlainConsole()
        if not watch:
            console.print(status_table(look.now()))
            return
        _watch(look, console)


def _watch(look: Look, console: PlainConsole) -> None:
    def over(observed: Observed) -> bool:
        return observed.status.finished or bool(observed.status.failed)

    observed = look.now()
    with Live(status_table(observed), console=console, auto_refresh=False, screen=False) as live:
        while not over(observed):
            time.sleep(REFRESH_S)
            observed = look.now()
            live.update(status_table(observed), refresh=True)


def _list(connect: str, certs: Path | None, *, watch: bool, json: bool) -> None:
    """Print the runs of a router, once or until Ctrl-C."""
    bus = join(connect, ANY_RUN, shown_role(certs), certs=certs)
    try:
        runs = Runs(bus)
        time.sleep(HEAR_S)
        if json:
            plain = [section_to_mapping(status) for status in runs.statuses()]
            sys.stdout.write(json_module.dumps(plain) + "\n")
        elif watch:
            with Live(runs_table(runs.statuses()), console=PlainConsole(), auto_refresh=False) as live:
                while True:
                    time.sleep(REFRESH_S)
                    live.update(runs_table(runs.statuses()), refresh=True)
        else:
            PlainConsole().print(runs_table(runs.statuses()))
    finally:
        bus.close()
