"""`readygo status`: the progress of a run, and its workers."""

import json as json_module
import sys
import time
from dataclasses import dataclass, field
from pathlib import Path

from rich.live import Live
from tyro.conf import Positional

from readygo.apps.commands.control import join_run, shown_role
from readygo.apps.fleet.access import join
from readygo.apps.fleet.options import JoinOptions
from readygo.apps.fleet.runs import ANY_RUN, HEAR_S, Runs
from readygo.apps.observe.status import Observed, RunStatus, runs_table, status_table
from readygo.apps.terminal import PlainConsole
from readygo.common.config import section_to_mapping
from readygo.common.errors import BusError, PeerError

REFRESH_S = 1.0
LISTEN_S = 1.5
"""Time in which every process reports its use of the machine once [s]."""


@dataclass(frozen=True, kw_only=True)
class StatusOptions:
    """Show the progress of a run: the queue of every stage, rates, remaining time, workers with their leases, disks.

    With only `connect` it lists the runs of a router, highest priority first.
    """

    data: Positional[Path | None] = None
    """Data folder that a fleet on this machine is recording into."""
    watch: bool = False
    """Refresh until the run is finished, or Ctrl-C."""
    json: bool = False
    """Print all numbers as JSON."""
    fleet: JoinOptions = field(default_factory=JoinOptions)


def status(options: StatusOptions) -> None:
    """Show the progress of a run."""
    if options.data is None and options.fleet.connect and not options.fleet.run:
        _list(options.fleet.connect, options.fleet.certs, watch=options.watch, json=options.json)
        return
    with join_run(options.data, options.fleet.connect, options.fleet.run, options.fleet.certs) as bus:
        look = RunStatus(bus)
        if options.json:
            observed = look.now()
            plain = {**section_to_mapping(observed.status), "fleet": section_to_mapping(observed.fleet)}
            sys.stdout.write(json_module.dumps(plain) + "\n")
            return
        time.sleep(LISTEN_S)
        console = PlainConsole()
        if not options.watch:
            console.print(status_table(look.now()))
            return
        _watch(look, console)


def _watch(look: RunStatus, console: PlainConsole) -> None:
    def over(observed: Observed) -> bool:
        return observed.status.finished or bool(observed.status.failed)

    observed = look.now()
    with Live(status_table(observed), console=console, auto_refresh=False, screen=False) as live:
        while not over(observed):
            time.sleep(REFRESH_S)
            try:
                observed = look.now()
            except PeerError:
                raise
            except BusError:
                # A run that ends may be gone before it is asked again.
                console.print("Nothing answers for the run any more: it has ended, or its coordinator has stopped.")
                return
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
