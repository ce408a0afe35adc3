"""Memory and processor time of `readygo monitor` while a run continues and viewers look at its page.

    readygo learn embedded --form policy --out RUN &
    python -m readygo.benchmarks.recording.watching RUN --minutes 30 --viewers 2

A viewer takes all that the page would be sent (the WebSocket of viser) and draws nothing, so that the monitor alone is
measured; each one leaves after a minute and comes again, as a browser does that is closed and opened. Memory is private
memory (/proc/PID/smaps_rollup, Linux), read every ten seconds; its growth is a line through the readings of the second
half [MB/h], since a run fills bounded histories at first.
"""

import contextlib
import json
import os
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any, NamedTuple

import msgpack
import numpy as np
import tyro

from readygo.benchmarks.recording.memory import reading_of

PERIOD_S = 10.0
STAYS_S = 60.0
CAMERA = {
    "type": "ViewerCameraMessage",
    "wxyz": (1.0, 0.0, 0.0, 0.0),
    "position": (0.0, 0.0, 3.0),
    "fov": 1.2,
    "near": 0.01,
    "far": 1000.0,
    "image_height": 800,
    "image_width": 1280,
    "look_at": (1.0, 0.0, 0.0),
    "up_direction": (0.0, 0.0, 1.0),
}
"""What viser's page says first; it counts as connected from then on."""


class MonitorCost(NamedTuple):
    """What a monitor holds and has spent, and what its viewers have got, since it was started."""

    time_s: float
    private_mb: float
    cpu_s: float
    received_mb: float


class Viewers:
    """Threads that take what a page is sent, leave and come again."""

    def __init__(self, address: str, count: int) -> None:
        """Begin to look.

        Args:
            address: Address of the page, ws://HOST:PORT/; it may come later.
            count: Viewers.
        """
        self.received = [0] * count
        """Bytes that each viewer has got."""
        self.visits = [0] * count
        self._address = address
        self._over = threading.Event()
        self._threads = [threading.Thread(target=self._look, args=(number,), daemon=True) for number in range(count)]
        for thread in self._threads:
            thread.start()

    def _look(self, number: int) -> None:
        while not self._over.is_set():
            with contextlib.suppress(OSError):
                self._visit(number, time.monotonic() + STAYS_S)
            self._over.wait(0.5)

    def _visit(self, number: int, until: float) -> None:
        import viser
        from websockets.exceptions import ConnectionClosed
        from websockets.sync.client import connect
        from websockets.typing import Subprotocol

        speaks = [Subprotocol(f"viser-v{viser.__version__}")]
        with connect(self._address, subprotocols=speaks, max_size=None, proxy=None) as page:
            page.send(msgpack.packb(CAMERA))
            self.visits[number] += 1
            while time.monotonic() < until and not self._over.is_set():
                with contextlib.suppress(TimeoutError):
                    try:
                        self.received[number] += len(page.recv(timeout=1.0))
                    except ConnectionClosed:
                        return

    def close(self) -> None:
        """Leave."""
        self._over.set()
        for thread in self._threads:
            thread.join()


def growth_mb_per_h(moments: Sequence[MonitorCost]) -> float:
    """Slope of a line through private memory in the second half of the time, by least squares."""
    half = [moment for moment in moments if moment.time_s >= moments[-1].time_s / 2]
    return float(np.polyfit([m.time_s / 3600 for m in half], [m.private_mb for m in half], 1)[0])


def main(
    run: Path,
    /,
    *,
    minutes: float = 30.0,
    viewers: int = 2,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        run: Folder of a run, as `readygo monitor` takes it.
        minutes: Wall time; at least one.
        viewers: Who look at the page at once.
        json_output: Print JSON.
    """
    with _monitor(run) as (pid, address):
        looking = Viewers(address, viewers)
        moments = list(_moments(pid, looking, minutes * 60))
        looking.close()
    result = summary(moments, looking.visits)
    print(json.dumps(result) if json_output else "\n".join(f"{key:22} {value}" for key, value in result.items()))


def summary(moments: Sequence[MonitorCost], visits: Sequence[int]) -> dict[str, Any]:
    """Figures of a time of watching; `private_mb` is read at ten moments from the first to the last one."""
    last = moments[-1]
    tenths = [moments[round(k * (len(moments) - 1) / 9)] for k in range(10)]
    return {
        "minutes": round(last.time_s / 60, 1),
        "visits": sum(visits),
        "received_mb": round(last.received_mb, 1),
        "cpu_share": round(last.cpu_s / last.time_s, 3),
        "private_mb": [round(moment.private_mb, 1) for moment in tenths],
        "growth_mb_per_h": round(growth_mb_per_h(moments), 1),
    }


@contextlib.contextmanager
def _monitor(run: Path) -> Iterator[tuple[int, str]]:
    """Process number of a monitor of a run and the address of its page, ended with the block."""
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    command = [sys.executable, "-m", "readygo", "monitor", str(run), "--port", str(port)]
    with subprocess.Popen(command) as process:
        try:
            yield process.pid, f"ws://127.0.0.1:{port}/"
        finally:
            process.terminate()


def _moments(pid: int, viewers: Viewers, span_s: float) -> Iterator[MonitorCost]:
    begun = time.monotonic()
    while (elapsed := time.monotonic() - begun) < span_s:
        reading = reading_of(pid)
        if reading is None:
            raise SystemExit("The monitor has ended before its time.")
        yield MonitorCost(elapsed, reading["private_mb"], cpu_s(pid), sum(viewers.received) / 1e6)
        time.sleep(PERIOD_S)


def cpu_s(pid: int) -> float:
    """Processor time of a process so far, user and system [s]."""
    fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")


if __name__ == "__main__":
    tyro.cli(main)
