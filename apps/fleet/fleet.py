"""A fleet on this machine: one process per worker, supervised and restarted."""

import logging
import signal
import subprocess
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from readygo.apps.fleet.fork_server import Forked, ForkServer
from readygo.apps.fleet.token import with_token
from readygo.apps.observe.logs import message_of
from readygo.apps.observe.settings import NOTHING, Observing
from readygo.common.bus.identity import COORDINATOR, RECORDER
from readygo.common.dataset.places import shard_folders
from readygo.common.errors import CANNOT_WORK, RunError

log = logging.getLogger(__name__)

RESTARTS_MAX = 10
"""Largest number of restarts of a worker within `RESTARTS_S`; a further one ends the run."""
RESTARTS_S = 3600.0
FROZEN_S = 20.0
"""Time after which a stopped process (SIGSTOP) is replaced by a new one [s]."""
STOP_S = 15.0
"""Time for recorders and coordinator to finish their work at the end [s]."""
DROP_S = 5.0
"""Time for workers to end [s]; unfinished work is done again."""


@dataclass
class Member:
    """One position in the fleet, and its current process."""

    role: str
    name: str
    log: Path
    arguments: tuple[str, ...] = ()
    """Further arguments of its command line."""
    process: Forked | None = None
    restarts: int = 0
    restarted_s: deque[float] = field(default_factory=deque)
    """Times of its restarts within the last `RESTARTS_S` [s]."""
    stopped_s: float | None = None
    """Time since which its process is stopped [s]; None while it runs."""


class Fleet:
    """Worker processes of one run."""

    def __init__(
        self,
        *,
        connect: str,
        run: str,
        data: Path | Sequence[Path],
        logs: Path,
        token: str = "",
        observing: Observing = NOTHING,
        certs: Path | None = None,
        forks: ForkServer | None = None,
    ) -> None:
        """Prepare a fleet without workers.

        Args:
            connect: Endpoint of the run's router.
            run: Name of the run, or several separated by commas.
            data: Data folder of the run, or one for each run.
            logs: Folder for the logs of the processes.
            token: Token of the run.
            observing: Metrics and logs of the processes.
            certs: Folder of certificates, for an endpoint tls/...
            forks: Server that forks the processes; by default a separate one, which ends with the fleet.
        """
        self._data = [data] if isinstance(data, Path) else list(data)
        self._arguments = ["--connect", connect, "--run", run, "--data", *map(str, self._data), "--exit-with-parent"]
        self._arguments += observing.of_member()
        self._arguments += ["--certs", str(certs.resolve())] if certs else []
        self._logs = logs
        self._forks = forks or ForkServer(with_token(token), logs / "fork-server.log")
        self._owns_forks = forks is None
        self.members: list[Member] = []

    def add(self, role: str, name: str, *arguments: str) -> None:
        """Start a worker; `arguments` are appended to its command line."""
        member = Member(role=role, name=name, log=self._logs / f"{name}.log", arguments=arguments)
        self.members.append(member)
        self._start(member)

    def remove(self, name: str) -> None:
        """End a worker; other workers do its unfinished work."""
        (member,) = (member for member in self.members if member.name == name)
        self.members.remove(member)
        self._stop([member])

    def kill(self, role: str) -> None:
        """Kill the workers of a role; `check` restarts them."""
        for member in self.members:
            if member.role == role and member.process:
                member.process.kill()
                member.process.wait()

    def check(self) -> None:
        """Restart workers that ended for any reason; call it only while the run is not over.

        Raises:
            RunError: If a worker ends repeatedly; the message contains the last line of its log.
        """
        for member in self.members:
            code = member.process.poll() if member.process else 0
            if code is None and not _is_frozen(member):
                continue
            if code == CANNOT_WORK or _restarts(member) >= RESTARTS_MAX:
                raise RunError(f"Worker {member.name} ended with exit code {code}: {last_words(member.log)}")
            if code is None and member.process:
                log.warning("%s is stopped and does not continue: it is restarted", member.name)
                member.process.kill()
                member.process.wait()
            member.restarts += 1
            member.restarted_s.append(time.monotonic())
            self._start(member)

    def stop(self) -> None:
        """End the fleet: workers first, then recorders, the coordinator last; no process is left behind."""
        last = (RECORDER, COORDINATOR)
        self._stop([member for member in self.members if member.role not in last], DROP_S)
        for role in last:
            self._stop([member for member in self.members if member.role == role])
        if self._owns_forks:
            self._forks.close()

    def _stop(self, members: list[Member], patience_s: float = STOP_S) -> None:
        """End workers at the same time; kill those that take too long."""
        processes = [member.process for member in members if member.process]
        for process in processes:
            process.terminate()
            # A stopped process cannot handle SIGTERM.
            process.send_signal(signal.SIGCONT)
        deadline_s = time.monotonic() + patience_s
        for process in processes:
            try:
                process.wait(timeout=max(0.1, deadline_s - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            process.stdin.close()

    def check_recorders(self) -> None:
        """Check the exit codes of the recorders, after `stop`.

        A recorder that the signal ended while it was starting has begun no shard.

        Raises:
            RunError: If one of them could not finish its shard.
        """
        unfinished = any(
            part for data in self._data for place in shard_folders(data) for part in place.glob("shard-*.mcap.part")
        )
        for member in self.members:
            code = member.process.returncode if member.process else 0
            fine = code == 0 or (code == -signal.SIGTERM and not unfinished)
            if member.role == RECORDER and not fine:
                raise RunError(
                    f"Recorder {member.name} could not finish its shard (exit code {code}): {last_words(member.log)} "
                    "Its episodes are safe; run the same command again to finish it."
                )

    def command(self, member: Member) -> list[str]:
        """The command line of a member, after `readygo`."""
        return ["worker", member.role, "--name", member.name, *member.arguments, *self._arguments]

    def _start(self, member: Member) -> None:
        if member.process:
            member.process.stdin.close()
        with member.log.open("ab") as log:
            member.process = self._forks.start(self.command(member), log.fileno())


def _restarts(member: Member) -> int:
    """Number of restarts of a worker within the last `RESTARTS_S`."""
    while member.restarted_s and time.monotonic() - member.restarted_s[0] > RESTARTS_S:
        member.restarted_s.popleft()
    return len(member.restarted_s)


def _is_frozen(member: Member) -> bool:
    """True if a worker's process has been stopped for `FROZEN_S`."""
    if not member.process or not _is_stopped(member.process.pid):
        member.stopped_s = None
        return False
    member.stopped_s = time.monotonic() if member.stopped_s is None else member.stopped_s
    return time.monotonic() - member.stopped_s >= FROZEN_S


def _is_stopped(pid: int) -> bool:
    """True if a process is stopped, by SIGSTOP for example; always False on systems without /proc."""
    try:
        # The state follows the name in brackets, which may contain any character.
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] in ("T", "t")
    except OSError:
        return False


def last_words(log: Path) -> str:
    """The last line of a worker's log."""
    lines = log.read_text(errors="replace").strip().splitlines() if log.exists() else []
    return message_of(lines[-1]) if lines else "it left no log."
