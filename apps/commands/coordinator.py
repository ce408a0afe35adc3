"""`readygo coordinator`: lead a run whose workers are on other machines."""

import sys
from pathlib import Path
from typing import Annotated

from readygo.apps.fleet.lead import lead
from readygo.apps.observe.logs import LogFormat, begin_logging
from readygo.apps.observe.observer import Observer
from readygo.apps.observe.settings import OBSERVING, Observing
from readygo.apps.run.folder import RunFolder
from readygo.common.bus.identity import COORDINATOR


def coordinator(
    data: Path,
    /,
    *,
    listen: str,
    certs: Path | None = None,
    metrics: Annotated[str, OBSERVING] = "",
    log_format: Annotated[LogFormat, OBSERVING] = "text",
    traces: Annotated[str, OBSERVING] = "",
) -> None:
    """Lead the run in a data folder: router, ledger and blobs, until it is over; started again, it goes on.

    Workers and recorders join it from any machine with `readygo worker`; a recorder writes its shards where it runs.
    `readygo generate ... --on hosts` begins such a run.

    Args:
        data: Data folder of the run.
        listen: Endpoint of the router, tls/HOST:PORT with certificates; 0.0.0.0 stands for all addresses.
        certs: Folder with the coordinator's certificate, for a tls/ endpoint.
        metrics: HOST:PORT where Prometheus finds this process; port 0 takes a free one, which the log names.
        log_format: "json" writes one JSON object a line.
        traces: Where OpenTelemetry's spans go: an OTLP endpoint such as http://collector:4318, or a folder.
    """
    lead_run(data, listen, certs, Observing(metrics=metrics, log_format=log_format, traces=traces))


def lead_run(data: Path, listen: str, certs: Path | None, observing: Observing) -> None:
    """Lead a run, and say what came of it; see `coordinator`."""
    folder = RunFolder(data)
    run = folder.load()[0].run
    begin_logging(observing.log_format, run=run, role=COORDINATOR, worker=COORDINATOR)
    with Observer(observing, run=run, role=COORDINATOR, name=COORDINATOR, state=folder.state) as observer:
        status = lead(folder, listen, certs=certs, observer=observer)
    sys.stderr.write(f"{status.committed} episodes, {status.samples} samples, in the shards of their recorders.\n")
