"""`readygo coordinator`: lead a run whose workers are on other machines."""

import logging
import sys
from pathlib import Path

from readygo.apps.fleet.lead import lead
from readygo.apps.run.folder import RunFolder


def coordinator(data: Path, /, *, listen: str, certs: Path | None = None) -> None:
    """Lead the run in a data folder: router, ledger and blobs, until it is over; started again, it goes on.

    Workers and recorders join it from any machine with `readygo worker`; a recorder writes its shards where it runs.
    `readygo generate ... --on hosts` begins such a run.

    Args:
        data: Data folder of the run.
        listen: Endpoint of the router, tls/HOST:PORT with certificates; 0.0.0.0 stands for all addresses.
        certs: Folder with the coordinator's certificate, for a tls/ endpoint.
    """
    logging.basicConfig(level=logging.INFO, stream=sys.stderr, format="%(asctime)s %(name)s %(levelname)s %(message)s")
    status = lead(RunFolder(data), listen, certs=certs)
    sys.stderr.write(f"{status.committed} episodes, {status.samples} samples, in the shards of their recorders.\n")
