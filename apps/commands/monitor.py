"""`readygo monitor`: a run to look at, while it goes on or afterwards."""

import ipaddress
import os
import secrets
import sys
import threading
import webbrowser
from pathlib import Path

from rich.console import Console

from readygo.apps.fleet.token import given_token
from readygo.apps.monitor.screen import Screen
from readygo.apps.monitor.subject import Subject, subject_at, subjects_of
from readygo.common.errors import RunError

PAGE_TOKEN_VARIABLE = "READYGO_MONITOR_TOKEN"
"""The token that the page asks for on other addresses than the loopback one; a new one without it."""


def monitor(
    data: Path | None = None,
    /,
    *,
    connect: str = "",
    run: str = "",
    scene: str = "",
    host: str = "127.0.0.1",
    port: int = 8080,
    open: bool = False,
) -> None:
    """Show a run on a page: scene, robots and humans as they move, images, numbers, workers; it only looks.

    Args:
        data: Data folder, live or recorded, or the folder of `readygo learn`.
        connect: Endpoint of a fleet's router, in place of the folder; its token comes in READYGO_TOKEN.
        run: Name of the run there, as `readygo generate --listen` prints it.
        scene: Scene bundle or "embedded", where it is not where the run says.
        host: Address to show the page on; others than this machine's own one ask for the token in the link.
        port: Its port; 0 takes a free one.
        open: Open the page in this machine's browser.
    """
    if (data is None) == (not connect):
        raise RunError("Name what to watch: a folder, or --connect ENDPOINT --run RUN.")
    if connect and not run:
        raise RunError(
            "--connect needs the name of the run as well: --run RUN, as `readygo generate --listen` prints it."
        )
    subjects = subjects_of(data, scene) if data is not None else [subject_at(connect, run, given_token(), scene)]
    show(subjects, host=host, port=port, browser=open)


def show(subjects: list[Subject], *, host: str, port: int, browser: bool = False) -> None:
    """Serve the page until somebody stops it."""
    token = "" if _is_loopback(host) else os.environ.get(PAGE_TOKEN_VARIABLE) or secrets.token_urlsafe(16)
    for subject in subjects:
        subject.start()
    screen = Screen(subjects, host=host, port=port, token=token)
    try:
        url = f"http://{_named(host)}:{screen.port}/" + (f"?token={token}" if token else "")
        Console(stderr=True, highlight=False, soft_wrap=True).print(f"Watch it at {url} (Ctrl-C ends this page alone)")
        sys.stderr.flush()
        if browser and _has_desktop():
            webbrowser.open(url)
        threading.Event().wait()
    except KeyboardInterrupt as stop:
        raise KeyboardInterrupt("the page is gone, the run is as it was.") from stop
    finally:
        screen.close()
        for subject in subjects:
            subject.close()


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _has_desktop() -> bool:
    """False where a browser would open in the terminal, if at all."""
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _named(host: str) -> str:
    """The address as a link has it."""
    return f"[{host}]" if ":" in host else host
