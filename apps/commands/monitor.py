"""`readygo monitor`: shows a run, live or recorded."""

import contextlib
import ipaddress
import os
import secrets
import sys
import threading
import webbrowser
from dataclasses import dataclass, field
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.fleet.options import JoinOptions
from readygo.apps.fleet.token import given_token
from readygo.apps.monitor.feed import Feed
from readygo.apps.monitor.foxglove_sink import FoxgloveSink
from readygo.apps.monitor.link import RunAddress
from readygo.apps.monitor.rerun_sink import RerunSink
from readygo.apps.monitor.screen import Screen
from readygo.apps.monitor.subject import Subject, subject_at, subjects_of
from readygo.apps.terminal import PlainConsole
from readygo.common.bus.endpoint import check_endpoint
from readygo.common.errors import RunError

PAGE_TOKEN_VARIABLE = "READYGO_MONITOR_TOKEN"
"""Environment variable with the token that the page requires on non-loopback addresses; random if unset."""


@dataclass(frozen=True, kw_only=True)
class MonitorOptions:
    """Show a run on a web page: scene, robots and pedestrians in motion, images, metrics, workers; read-only.

    The page can be opened and closed at any time without an effect on the run. It also shows finished data folders.
    """

    data: Positional[Path | None] = None
    """Data folder, live or recorded, or the folder of `readygo learn`."""
    scene: str = ""
    """Scene bundle or "embedded", if the scene is not where the run found it."""
    host: str = "127.0.0.1"
    """Address of the page; on any address but this machine's loopback one the page requires the token in the link."""
    port: int = 8080
    """Port of the page; 0 takes a free one."""
    open: bool = False
    """Open the page in this machine's browser."""
    foxglove: int | None = None
    """Serve the run to Foxglove on this port, such as 8765, instead of the page: the channels of a shard, live."""
    rerun: str | None = None
    """Show the run in Rerun instead of the page: `spawn` starts a viewer; else the address of a viewer, such as
    rerun+http://127.0.0.1:9876/proxy, or an .rrd file."""
    fleet: JoinOptions = field(default_factory=JoinOptions)


def monitor(options: MonitorOptions) -> None:
    """Show a run on a web page: scene, robots and pedestrians in motion, images, metrics, workers; read-only."""
    if (options.data is None) == (not options.fleet.connect):
        raise RunError("Name what to watch: a folder, or --connect ENDPOINT --run RUN.")
    if options.fleet.connect and not options.fleet.run:
        raise RunError(
            "--connect needs the name of the run as well: --run RUN, as `readygo generate --listen` prints it."
        )
    if options.fleet.connect:
        # Otherwise the page would retry a malformed endpoint forever.
        check_endpoint(options.fleet.connect, "--connect")
    if options.data is not None:
        subjects = subjects_of(options.data, options.scene, options.fleet.certs)
    else:
        subjects = [
            subject_at(
                RunAddress(options.fleet.connect, options.fleet.run, given_token(), options.fleet.certs), options.scene
            )
        ]
    with contextlib.ExitStack() as opened:
        for subject in subjects:
            opened.callback(subject.close)
            subject.start()
        try:
            if options.foxglove is not None or options.rerun is not None:
                _feed(opened, subjects[0], options.foxglove, options.rerun)
            else:
                _serve(opened, subjects, options.host, options.port, browser=options.open)
            _wait()
        except KeyboardInterrupt as stop:
            raise KeyboardInterrupt("the run is as it was.") from stop


def _feed(opened: contextlib.ExitStack, subject: Subject, foxglove: int | None, rerun: str | None) -> None:
    """Show a run in Foxglove or Rerun."""
    subject.read_scene()
    if foxglove is not None:
        server = FoxgloveSink(subject.robot, subject.maps, foxglove, subject.sensor)
        opened.callback(Feed(subject, server).close)
        _say(f"Foxglove: Open connection, Foxglove WebSocket, ws://127.0.0.1:{server.port} (Ctrl-C ends it)")
    if rerun is not None:
        opened.callback(Feed(subject, RerunSink(subject.robot, subject.house, rerun)).close)
        _say("Rerun shows it (Ctrl-C ends it)")


def _serve(opened: contextlib.ExitStack, subjects: list[Subject], host: str, port: int, *, browser: bool) -> None:
    """Serve the web page, and open it in the browser on request."""
    token = "" if _is_loopback(host) else os.environ.get(PAGE_TOKEN_VARIABLE) or secrets.token_urlsafe(16)
    screen = Screen(subjects, host=host, port=port, token=token)
    opened.callback(screen.close)
    url = f"http://{_url_host(host)}:{screen.port}/" + (f"?token={token}" if token else "")
    _say(f"Watch it at {url} (Ctrl-C ends this page alone)")
    if browser and _has_desktop():
        webbrowser.open(url)


def _wait() -> None:
    threading.Event().wait()


def _say(text: str) -> None:
    PlainConsole(stderr=True, soft_wrap=True).print(text, markup=False)


def _is_loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"


def _has_desktop() -> bool:
    """True on a machine with a graphical desktop; elsewhere a browser could only open in the terminal."""
    return sys.platform == "darwin" or bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _url_host(host: str) -> str:
    """The host as a URL spells it: IPv6 addresses in brackets."""
    return f"[{host}]" if ":" in host else host
