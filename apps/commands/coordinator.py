"""`readygo coordinator`: coordinate a run whose workers are on other machines."""

import sys
from pathlib import Path
from typing import Annotated

from readygo.apps.fleet.lead import lead
from readygo.apps.observe.logs import LogFormat, begin_logging
from readygo.apps.observe.observer import Observer
from readygo.apps.observe.settings import OBSERVING, Observing
from readygo.apps.run.config import with_priority
from readygo.apps.run.folder import RunFolder
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.bus.identity import COORDINATOR
from readygo.common.dataset.aside import set_aside_lines
from readygo.common.errors import RunError


def coordinator(
    data: Path,
    /,
    *,
    listen: str = "",
    connect: str = "",
    priority: int | None = None,
    certs: Path | None = None,
    strict: bool = False,
    metrics: Annotated[str, OBSERVING] = "",
    log_format: Annotated[LogFormat, OBSERVING] = "text",
) -> None:
    """Coordinate the run in a data folder (router, ledger, blobs) until it is finished; a restart resumes it.

    Workers and recorders join from any machine with `readygo worker`; each recorder writes its shards on its own
    machine. `readygo generate ... --on hosts` begins such a run. With `connect`, several runs share a router and a
    fleet.

    Args:
        data: Data folder of the run.
        listen: Endpoint of the run's own router, tls/HOST:PORT with certificates; 0.0.0.0 stands for all addresses.
        connect: Endpoint of a running router (`readygo router`) that several runs share, instead of `listen`.
        priority: Priority of this run, -1000..1000: workers of several runs serve higher ones first; unchanged by
            default, 0 in a new run.
        certs: Folder with the coordinator's certificate, for a tls/ endpoint.
        strict: Exit with 2 if an episode was set aside: it failed repeatedly, and the next index replaced it.
        metrics: HOST:PORT of this process's Prometheus endpoint; port 0 takes a free one, which the log names.
        log_format: "json" writes one JSON object per line.
    """
    check_endpoints(listen, connect)
    folder = RunFolder(data)
    if priority is not None:
        with folder.locked():
            spec, wanted = folder.load()
            folder.save(with_priority(spec, priority), wanted)
    observing = Observing(metrics=metrics, log_format=log_format)
    lead_run(folder, listen or connect, joins=bool(connect), certs=certs, strict=strict, observing=observing)


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


def lead_run(
    folder: RunFolder, endpoint: str, *, joins: bool, certs: Path | None, observing: Observing, strict: bool = False
) -> None:
    """Coordinate a run until it is finished, then print its episode and sample counts and warnings."""
    run = folder.load()[0].run
    begin_logging(observing.log_format, run=run, role=COORDINATOR, worker=COORDINATOR)
    with Observer(observing, run=run, role=COORDINATOR, name=COORDINATOR, state=folder.state) as observer:
        status = lead(folder, endpoint, joins=joins, certs=certs, observer=observer)
    sys.stderr.write(f"{status.committed:,} episodes, {status.samples:,} samples, in the shards of their recorders.\n")
    report_set_aside(folder.path, strict=strict)
