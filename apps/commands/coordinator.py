"""`readygo coordinator`: coordinate a run whose workers are on other machines."""

import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from tyro.conf import Fixed, Positional

from readygo.apps.fleet.lead import lead
from readygo.apps.fleet.options import FleetOptions
from readygo.apps.observe.logs import begin_logging
from readygo.apps.observe.observer import ProcessObserver
from readygo.apps.observe.settings import Observing
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.bus.identity import COORDINATOR
from readygo.common.dataset.aside import set_aside_lines
from readygo.common.errors import RunError
from readygo.runs.config import with_run_keys
from readygo.runs.folder import RunFolder
from readygo.runs.sections import Keys, Sections
from readygo.services.coordinator import CoordinatorConfig


@dataclass(frozen=True, kw_only=True)
class CoordinatorOptions:
    """Coordinate the run in a data folder (router, ledger, blobs) until it is finished; a restart resumes it.

    Workers and recorders join from any machine with `readygo worker`; each recorder writes its shards on its own
    machine. `readygo generate ... --on hosts` begins such a run. With `connect`, several runs share a router and a
    fleet.
    """

    data: Positional[Path]
    """Data folder of the run."""
    strict: bool = False
    """Exit with 2 if an episode was set aside: it failed repeatedly, and the next index replaced it."""
    fleet: FleetOptions = field(default_factory=FleetOptions)
    observe: Observing = field(default_factory=Observing)
    keys: Annotated[Keys, Sections(coordinator=CoordinatorConfig), Fixed] = field(default_factory=dict)


def coordinator(options: CoordinatorOptions) -> None:
    """Coordinate the run in a data folder (router, ledger, blobs) until it is finished; a restart resumes it."""
    check_endpoints(options.fleet.listen, options.fleet.connect)
    folder = RunFolder(options.data)
    if options.keys:
        with folder.lock():
            spec, wanted = folder.load()
            folder.save(with_run_keys(spec, options.keys), wanted)
    lead_run(folder, options.fleet, strict=options.strict, observing=options.observe)


def check_endpoints(listen: str, connect: str) -> None:
    """Raise RunError unless exactly one of the two is given, ConfigError if it is not a valid endpoint."""
    if bool(listen) == bool(connect):
        raise RunError(
            "Name one of --listen, for a router of the run's own, such as tls/10.0.0.5:7447, and --connect, for one "
            "that is there already."
        )
    check_endpoint(listen or connect, "--listen" if listen else "--connect")


def report_set_aside(data: Path, *, strict: bool) -> None:
    """Warn of every episode that a run gave up.

    Raises:
        RunError: If there is one and `strict` is set.
    """
    lines = set_aside_lines(data)
    for line in lines:
        sys.stderr.write(f"Warning: {line}\n")
    if lines and strict:
        raise RunError(f"{len(lines)} episodes of {data} were set aside, which --strict does not allow.")


def lead_run(folder: RunFolder, fleet: FleetOptions, *, observing: Observing, strict: bool = False) -> None:
    """Coordinate a run until it is finished, then print its episode and sample counts and warnings."""
    run, endpoint = folder.load()[0].run, fleet.listen or fleet.connect
    begin_logging(observing.log_format, run=run, role=COORDINATOR, worker=COORDINATOR)
    with ProcessObserver(observing, run=run, role=COORDINATOR, name=COORDINATOR, state=folder.state) as observer:
        status = lead(folder, endpoint, joins=bool(fleet.connect), certs=fleet.certs, observer=observer)
    sys.stderr.write(f"{status.committed:,} episodes, {status.samples:,} samples, in the shards of their recorders.\n")
    report_set_aside(folder.path, strict=strict)
