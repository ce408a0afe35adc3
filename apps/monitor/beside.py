"""The page of a run that is about to begin: a separate process, which ends with the run's command."""

import contextlib
import importlib.util
import subprocess
import sys
import threading
from collections.abc import Callable, Iterator
from pathlib import Path

from readygo.common.errors import RunError
from readygo.common.extras import install_command

POLL_S = 0.5


def check_viewer() -> None:
    """Raise RunError if viser, which draws the page, is not installed."""
    if importlib.util.find_spec("viser") is None:
        raise RunError(f"--watch needs viser; install it with: {install_command('monitor')}")


@contextlib.contextmanager
def show_page(folder: Path, begun: Callable[[], bool], certs: Path | None = None) -> Iterator[None]:
    """Show a run on a page while the context is active; the page never blocks the run.

    Args:
        folder: Data folder, or folder of a learning run.
        begun: Returns True once the folder can be watched.
        certs: Folder with a monitor's certificate, for a run with TLS.

    Raises:
        RunError: If viser is not installed.
    """
    check_viewer()
    over = threading.Event()
    thread = threading.Thread(target=_show, args=(_command(folder, certs), begun, over), daemon=True)
    thread.start()
    try:
        yield
    finally:
        over.set()
        thread.join()


def _command(folder: Path, certs: Path | None) -> list[str]:
    command = [sys.executable, "-m", "readygo", "monitor", str(folder), "--port", "0", "--open"]
    return [*command, "--certs", str(certs)] if certs else command


def _show(command: list[str], begun: Callable[[], bool], over: threading.Event) -> None:
    while not begun():
        if over.wait(POLL_S):
            return
    process = subprocess.Popen(command, stdin=subprocess.DEVNULL, start_new_session=True)
    over.wait()
    # It only reads, and after SIGTERM it would write to the terminal of the run.
    process.kill()
    process.wait()
