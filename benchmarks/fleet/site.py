"""A run of `readygo generate` that is disturbed, and started again whenever it ends before all is recorded."""

import contextlib
import os
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from pathlib import Path

from readygo.apps.fleet.fleet import last_words
from readygo.apps.fleet.token import TOKEN_VARIABLE, new_token, with_token
from readygo.benchmarks.recording.memory import workers_below
from readygo.common.bus.zenoh_bus import ZenohBus
from readygo.common.dataset.committed import episode_indices
from readygo.common.dataset.places import own_folders
from readygo.common.errors import RunError
from readygo.runs.folder import RunFolder

LAUNCHER = "launcher"
"""The process that the user starts: it holds the router and the fleet."""
HUNG_S = 900.0
"""A run of which nothing becomes durable for so long hangs [s]."""
END_S = 120.0
"""So does a launcher that takes longer to end when it is told to [s]."""


class DataSite:
    """One data folder, and the command that fills it."""

    def __init__(self, command: Sequence[str], folder: RunFolder, log: Path) -> None:
        """Start nothing yet.

        Args:
            command: Arguments of `readygo`.
            folder: The data folder that the command fills.
            log: Where it says what it does.
        """
        self.folder = folder
        self.reruns: list[str] = []
        """Last words of every time that the command ended before it should, without those that were told to end."""
        self.hung = 0
        """How often nothing became durable for `HUNG_S`, or the command did not end when it was told to."""
        self._command = [sys.executable, "-m", "readygo", *command]
        self._log = log
        self._token = new_token()
        self._process: subprocess.Popen[bytes] | None = None
        self._told_to_end = False
        self._read: dict[Path, tuple[int, int]] = {}
        self._progress = (-1, time.monotonic())

    def start(self) -> None:
        """Start the command."""
        self._told_to_end = False
        with self._log.open("ab") as log:
            self._process = subprocess.Popen(
                self._command, stdout=log, stderr=log, env=with_token(self._token), start_new_session=True
            )

    def keep_up(self) -> bool:
        """Start the command again if it ended, unless it has done all: True then."""
        assert self._process is not None
        if self._process.poll() is None:
            self._end_hung()
            return False
        if self._process.returncode == 0:
            return True
        if not self._told_to_end:
            self.reruns.append(last_words(self._log))
        self.start()
        return False

    def end(self, number: signal.Signals) -> None:
        """Send the launcher a signal that ends it; `keep_up` starts it again. One that does not end hangs."""
        assert self._process is not None
        self._told_to_end = True
        self._process.send_signal(number)
        try:
            self._process.wait(timeout=END_S)
        except subprocess.TimeoutExpired:
            self.hung += 1
            self._process.kill()
            self._process.wait()

    def processes(self) -> dict[str, int]:
        """Process numbers of launcher and workers, by name."""
        assert self._process is not None
        if self._process.poll() is not None:
            return {}
        return {LAUNCHER: self._process.pid, **{name: pid for pid, name in workers_below(self._process.pid)}}

    def left_behind(self) -> list[int]:
        """Processes that know the run's token, which only those of its fleets do."""
        mark = f"{TOKEN_VARIABLE}={self._token}".encode()
        found = []
        for entry in Path("/proc").glob("[0-9]*"):
            try:
                environment = (entry / "environ").read_bytes()
            except OSError:
                continue
            if mark in environment.split(b"\0"):
                found.append(int(entry.name))
        return found

    def join(self) -> ZenohBus:
        """Join the run as a participant that has its token.

        Raises:
            ReadygoError: If no fleet is at work.
        """
        endpoint, token = self.folder.fleet_endpoint()
        return ZenohBus(endpoint, self.folder.load()[0].run, token)

    def shards(self) -> list[Path]:
        """Shards of the run, finished or open."""
        return [
            path
            for place in self.places()
            for path in sorted(place.glob("shard-*.mcap*"))
            if "index" not in path.suffix
        ]

    def places(self) -> list[Path]:
        """Folders with shards of the run."""
        return [place for place in [self.folder.path, *own_folders(self.folder.path).values()] if place.is_dir()]

    def durable(self) -> int:
        """Episodes in the shards, double ones counted twice; what was read of a shard once is not read again."""
        total = 0
        for shard in self.shards():
            end, count = self._read.get(shard, (0, 0))
            with contextlib.suppress(OSError):
                if shard.stat().st_size < end:
                    end, count = 0, 0
            found = list(episode_indices(shard, end))
            self._read[shard] = (found[-1][1] if found else end), count + len(found)
            total += count + len(found)
        return total

    def stop(self) -> None:
        """Kill the processes that are left of the run."""
        for pid in self.left_behind():
            os.kill(pid, signal.SIGKILL)
        if self._process is not None:
            self._process.wait()

    def _end_hung(self) -> None:
        count, since_s = self._progress
        now = self.durable()
        if now != count:
            self._progress = now, time.monotonic()
        elif time.monotonic() - since_s > HUNG_S:
            self.hung += 1
            self.reruns.append(f"nothing became durable for {HUNG_S:g} s")
            self._progress = now, time.monotonic()
            self.end(signal.SIGKILL)


def run_to_end(site: DataSite, *, patience_s: float, runs_max: int = 10) -> None:
    """Run the command until it says that all is recorded.

    Raises:
        RunError: If it does not.
    """
    deadline_s, begun = time.monotonic() + patience_s, len(site.reruns)
    while not site.keep_up():
        if time.monotonic() > deadline_s or len(site.reruns) - begun > runs_max:
            raise RunError(f"The run does not end: {site.reruns[-1] if site.reruns else 'it never finishes'}")
        time.sleep(0.2)
