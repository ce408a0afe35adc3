"""The page's server: a viser server at a Unix socket, behind a gate; the only module that imports viser."""

import contextlib
import io
import logging
import socket
import tempfile
import threading
import time
import warnings
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from readygo.apps.monitor.gate import Gate
from readygo.apps.monitor.page import Page
from readygo.apps.monitor.subject import Subject
from readygo.common.errors import RunError
from readygo.common.extras import install_command

FRAME_S = 0.1
"""Period of updates of the pages [s]."""
PAGES_MAX = 16
"""Largest number of browsers at the same time."""

SOCKET = "viewer"

log = logging.getLogger(__name__)


class Screen:
    """Serves pages until it is closed."""

    def __init__(self, subjects: list[Subject], *, host: str, port: int, token: str = "") -> None:
        """Start the server.

        Args:
            subjects: Runs to choose from, at least one.
            host: Address of this machine.
            port: Port; 0 takes a free one.
            token: Required token; empty for the loopback address.

        Raises:
            RunError: If viser is not installed, or the address cannot be opened.
        """
        self._subjects = subjects
        self._pages: dict[int, Page] = {}
        self._lock = threading.Lock()
        self._stop = threading.Event()
        with contextlib.ExitStack() as opened:
            # A folder that only this user can enter.
            folder = Path(opened.enter_context(tempfile.TemporaryDirectory(prefix="readygo-monitor-")))
            self._server = _viser_server(folder / SOCKET)
            opened.callback(_quietly, self._server.stop)
            self._gate = Gate(host, port, behind=folder / SOCKET, token=token)
            opened.callback(self._gate.close)
            self._opened = opened.pop_all()
        self.port: int = self._gate.port
        """Port of the server."""
        self._server.on_client_connect(self._open)
        self._server.on_client_disconnect(self._drop)
        self._thread = threading.Thread(target=self._draw, name="screen", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the server."""
        self._stop.set()
        self._thread.join()
        self._opened.close()

    def _open(self, client: Any) -> None:
        with self._lock:
            full = len(self._pages) >= PAGES_MAX
        if full:
            client.gui.add_markdown(f"{PAGES_MAX} browsers look at this already; close one of them and load again.")
            return
        page = Page(client, self._subjects)
        with self._lock:
            # The client may have disconnected while its page was built.
            if client.client_id in self._server.get_clients():
                self._pages[client.client_id] = page

    def _drop(self, client: Any) -> None:
        with self._lock:
            self._pages.pop(client.client_id, None)

    def _draw(self) -> None:
        while not self._stop.wait(FRAME_S):
            with self._lock:
                pages = list(self._pages.items())
            for number, page in pages:
                try:
                    page.update(time.monotonic())
                except Exception:
                    log.exception("page %d ends", number)
                    with self._lock:
                        self._pages.pop(number, None)


def _viser_server(path: Path) -> Any:
    """A viser server at a Unix socket, without viser's share URLs over a relay on the internet."""
    try:
        import viser
    except ImportError as error:
        raise RunError(f"`readygo monitor` needs viser; install it with: {install_command('monitor')}") from error

    # A browser may disconnect at any time, also while its page is built.
    warnings.filterwarnings("ignore", message="Queued a .* on a closed connection")

    class Server(viser.ViserServer):
        def request_share_url(self, verbose: bool = True) -> str | None:
            return None

    with _served_at(path):
        server: Any = _quietly(lambda: Server(host="127.0.0.1", port=0, verbose=False))
    server.gui.configure_theme(
        dark_mode=True, show_logo=False, show_share_button=False, control_width="large", brand_color=(41, 161, 255)
    )
    server.gui.set_panel_label("readygo monitor")
    server.scene.set_up_direction("+z")
    return server


@contextlib.contextmanager
def _served_at(path: Path) -> Iterator[None]:
    """Make a viser server that starts within the context listen at a Unix socket, for which it has no setting.

    A process of another user, or a page that a browser has open, could reach a TCP port without passing the gate.

    Raises:
        RunError: If the socket cannot be made.
    """
    from websockets.asyncio import server as websockets_server

    listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
    try:
        listener.bind(str(path))
    except OSError as error:
        listener.close()
        raise RunError(f"Cannot make a socket at {path}: {error}; set TMPDIR to a folder with a short name.") from error
    module: Any = websockets_server
    serve = module.serve
    served = False

    def serve_at_socket(handler: Any, host: str, port: int, **settings: Any) -> Any:
        nonlocal served
        served = True
        return serve(handler, unix=True, sock=listener, **settings)

    module.serve = serve_at_socket
    try:
        yield
    finally:
        module.serve = serve
        if not served:
            listener.close()
    assert served, "viser has another way to listen than before"


def _quietly(call: Any) -> Any:
    """Call a function without its output to standard output."""
    with contextlib.redirect_stdout(io.StringIO()):
        return call()
