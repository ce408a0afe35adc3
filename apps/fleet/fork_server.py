"""A process that has loaded the modules of a fleet's workers, and forks a worker on each request.

Loading takes a second of processor time and 70 MB, which each worker would otherwise need separately. A fork copies
only the thread that calls it: the server starts no thread and opens no session before.
"""

import contextlib
import gc
import json
import os
import select
import signal
import socket
import subprocess
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path

from setproctitle import setproctitle

import readygo
from readygo.apps.cli import CliCommand, run_command
from readygo.common.errors import RunError
from readygo.common.left_open import close_all

WORKER = CliCommand("readygo.apps.fleet.worker:worker", "join a fleet as one worker")
PATIENCE_S = 120.0
"""Time for the server to load all modules and to answer, also on a busy machine [s]."""
REPORT_S = 30.0
"""Time for the server to report the exit code of a process [s]."""
REQUEST_BYTES_MAX = 1 << 16


class Forked:
    """A process that a fork server forked, with an interface like `subprocess.Popen`."""

    def __init__(self, pid: int, pidfd: int, report: socket.socket, parent_end: int) -> None:
        self.pid = pid
        self.returncode: int | None = None
        self.stdin = open(parent_end, "wb", buffering=0)  # noqa: SIM115
        """The only writable end of its standard input: when it closes, the process knows that its parent is gone."""
        self._pidfd = pidfd
        self._report = report

    def __del__(self) -> None:
        os.close(self._pidfd)
        self._report.close()

    def poll(self) -> int | None:
        """Exit code of the process; None while it runs."""
        return self._poll_end(0.0)

    def wait(self, timeout: float | None = None) -> int:
        """Wait for the end of the process; returns its exit code.

        Raises:
            subprocess.TimeoutExpired: If the process still runs after `timeout` [s].
        """
        code = self._poll_end(timeout)
        if code is None:
            raise subprocess.TimeoutExpired(str(self.pid), timeout or 0.0)
        return code

    def send_signal(self, number: int) -> None:
        """Send a signal to the process, unless it has ended."""
        with contextlib.suppress(ProcessLookupError):
            signal.pidfd_send_signal(self._pidfd, number)

    def terminate(self) -> None:
        """Send SIGTERM to the process."""
        self.send_signal(signal.SIGTERM)

    def kill(self) -> None:
        """Send SIGKILL to the process."""
        self.send_signal(signal.SIGKILL)

    def _poll_end(self, timeout_s: float | None) -> int | None:
        if self.returncode is None and _readable(self._pidfd, timeout_s):
            self._report.settimeout(REPORT_S)
            try:
                said = self._report.recv(64)
            except OSError:
                said = b""
            # A server that has died or is stopped does not report exit codes.
            self.returncode = int(said or -signal.SIGKILL)
        return self.returncode


class ForkServer:
    """Client of the process that forks a fleet's workers; starts it when needed, and again if it dies."""

    def __init__(self, environment: Mapping[str, str], log: Path) -> None:
        """Prepare a server that is not started yet.

        Args:
            environment: Environment variables of its processes.
            log: File for the server's errors.
        """
        self._environment = dict(environment)
        self._log = log
        self._process: subprocess.Popen[bytes] | None = None
        self._control: socket.socket | None = None

    def start(self, words: Sequence[str], output: int) -> Forked:
        """Start a worker.

        Args:
            words: Command line of the worker after `readygo`.
            output: Descriptor of the file for its output.

        Raises:
            RunError: If the worker cannot be started.
        """
        try:
            return self._ask(words, output)
        except OSError:
            self.close()  # The server is dead or silent: a new one is asked.
        try:
            return self._ask(words, output)
        except OSError as error:
            self.close()
            trouble = error.strerror or error
            raise RunError(f"No worker can be started ({trouble}); see {self._log}.") from error

    def close(self) -> None:
        """End the server; the forked processes continue."""
        if self._control is not None:
            self._control.close()
            self._control = None
        if self._process is not None:
            self._process.kill()
            self._process.wait()
            self._process = None

    def load(self) -> None:
        """Start the server if it does not run; it loads its modules in the background."""
        if self._control is not None:
            return
        ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        self._control = ours
        with theirs, self._log.open("ab") as log:
            self._process = subprocess.Popen(
                [sys.executable, "-m", "readygo.apps.fleet.fork_server"],
                stdin=theirs.fileno(),
                stdout=log,
                stderr=log,
                cwd=Path(readygo.__file__).resolve().parents[1],
                env=self._environment,
                start_new_session=True,
            )

    def _ask(self, words: Sequence[str], output: int) -> Forked:
        """Request a new process.

        Raises:
            OSError: If the server is dead or does not answer.
        """
        self.load()
        assert self._control is not None
        report, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        child_end, parent_end = os.pipe()
        try:
            with theirs:
                request = json.dumps(list(words)).encode()
                socket.send_fds(self._control, [request], [theirs.fileno(), child_end, output])
            report.settimeout(PATIENCE_S)
            said, descriptors, _, _ = socket.recv_fds(report, 64, 1)
            if not said:
                raise ConnectionError("the fork server ended")
        except OSError:
            os.close(parent_end)
            report.close()
            raise
        finally:
            os.close(child_end)
        return Forked(int(said), descriptors[0], report, parent_end)


def _readable(descriptor: int, timeout_s: float | None) -> bool:
    waiting = select.poll()
    waiting.register(descriptor, select.POLLIN)
    return bool(waiting.poll(None if timeout_s is None else timeout_s * 1000.0))


def main() -> None:
    """Load the workers' modules, then fork a worker per request; ends when the launcher is gone."""
    _load()
    words = _serve(socket.socket(fileno=os.dup(0)))
    if words is not None:
        sys.argv = ["readygo", *words]
        try:
            run_command({"worker": WORKER}, words)
        finally:
            close_all()


def _load() -> None:
    """Load the workers' modules, the embedded avatars, and numba's initial state."""
    import cv2  # noqa: F401
    import tyro  # noqa: F401
    from numba.core.registry import cpu_target

    import readygo.apps.fleet.worker
    import readygo.runs.stages
    import readygo.runs.warm  # noqa: F401
    from readygo.runs.world import share_embedded_avatars

    share_embedded_avatars()
    cpu_target.target_context.refresh()
    gc.collect()
    # The collector ignores all existing objects from here on: visiting them would copy their memory pages.
    gc.freeze()


def _serve(control: socket.socket) -> list[str] | None:
    """Fork a process per request, and report exit codes.

    Returns:
        In a forked process its command line; in the server None, once the launcher has closed the connection.
    """
    children: dict[int, tuple[int, socket.socket]] = {}
    waiting = select.poll()
    waiting.register(control, select.POLLIN)
    while True:
        for descriptor, _ in waiting.poll():
            if descriptor in children:
                waiting.unregister(descriptor)
                _report_end(descriptor, *children.pop(descriptor))
                continue
            request, descriptors, _, _ = socket.recv_fds(control, REQUEST_BYTES_MAX, 3)
            if not request:
                return None
            words: list[str] = json.loads(request)
            report = socket.socket(fileno=descriptors[0])
            pid = os.fork()
            if not pid:
                _leave([control, report, *(each for _, each in children.values())], list(children))
                _become_process(words, *descriptors[1:])
                return words
            pidfd = os.pidfd_open(pid)
            children[pidfd] = pid, report
            waiting.register(pidfd, select.POLLIN)
            with contextlib.suppress(OSError):
                socket.send_fds(report, [str(pid).encode()], [pidfd])
            for taken in descriptors[1:]:
                os.close(taken)


def _report_end(pidfd: int, pid: int, report: socket.socket) -> None:
    code = os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1])
    with report, contextlib.suppress(OSError):
        report.send(str(code).encode())
    os.close(pidfd)


def _leave(sockets: Sequence[socket.socket], descriptors: Sequence[int]) -> None:
    """Close the server's sockets and descriptors in a forked process."""
    for each in sockets:
        each.close()
    for descriptor in descriptors:
        os.close(descriptor)


def _become_process(words: Sequence[str], standard_input: int, output: int) -> None:
    """Give a forked process a new session, its streams, and its command line in lists of processes."""
    os.setsid()
    for descriptor, number in ((standard_input, 0), (output, 1), (output, 2)):
        os.dup2(descriptor, number)
    os.close(standard_input)
    os.close(output)
    setproctitle(" ".join(["readygo", *words]))


if __name__ == "__main__":
    main()
