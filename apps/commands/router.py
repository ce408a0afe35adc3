"""`readygo router`: the router of a fleet that works on several runs."""

import sys
import threading
from dataclasses import dataclass
from pathlib import Path

from readygo.apps.fleet.access import TLS, open_router
from readygo.apps.fleet.token import TOKEN_VARIABLE, given_token
from readygo.common.errors import RunError


@dataclass(frozen=True, kw_only=True)
class RouterCommandOptions:
    """Run a router for the coordinators, recorders and workers of several runs, until Ctrl-C or SIGTERM.

    Runs can start and end at any time: `readygo generate ... --on hosts --connect` begins one, `readygo worker ROLE
    --connect` without --run works for all of them, `readygo status --connect` lists them.
    """

    listen: str
    """Endpoint, tls/HOST:PORT with certificates; 0.0.0.0 stands for all addresses."""
    certs: Path | None = None
    """Folder with a certificate of the role coordinator, for a tls/ endpoint."""
    recorders: tuple[str, ...] = ("rec0",)
    """Names of all recorders of the runs; each has separate rights."""


def router(options: RouterCommandOptions) -> None:
    """Run a router for the coordinators, recorders and workers of several runs, until Ctrl-C or SIGTERM."""
    token = given_token()
    if not token and not options.listen.startswith(TLS):
        raise RunError(f"Who may join? Give the processes of the fleet a secret, as {TOKEN_VARIABLE}, or certificates.")
    opened = open_router(options.recorders, options.listen, certs=options.certs, token=token)
    sys.stderr.write(f"listening on {options.listen}\n")
    try:
        threading.Event().wait()
    finally:
        opened.close()
