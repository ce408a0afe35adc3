"""`readygo router`: where a fleet meets that outlives its runs."""

import sys
import threading
from pathlib import Path

from readygo.apps.fleet.access import TLS, open_router
from readygo.apps.fleet.token import TOKEN_VARIABLE, given_token
from readygo.common.errors import RunError


def router(*, listen: str, certs: Path | None = None, recorders: tuple[str, ...] = ("rec0",)) -> None:
    """Let coordinators, recorders and workers of several runs meet, until Ctrl-C or SIGTERM.

    Runs come and go: `readygo generate ... --on hosts --connect` begins one, `readygo worker ROLE --connect` without
    --run works for all of them, `readygo status --connect` lists them.

    Args:
        listen: Endpoint, tls/HOST:PORT with certificates; 0.0.0.0 stands for all addresses.
        certs: Folder with a certificate of the role coordinator, for a tls/ endpoint.
        recorders: Names of the recorders that take part in any of the runs: each has rights of its own.
    """
    token = given_token()
    if not token and not listen.startswith(TLS):
        raise RunError(f"Who may join? Give the processes of the fleet a secret, as {TOKEN_VARIABLE}, or certificates.")
    opened = open_router(recorders, listen, certs=certs, token=token)
    sys.stderr.write(f"listening on {listen}\n")
    try:
        threading.Event().wait()
    finally:
        opened.close()
