"""What those who look on cost a fleet: monitors that hear everything, monitors and a live trainer that are frozen.

    python -m readygo.benchmarks.recording.beside embedded --episodes 8 --rounds 2

Runs `readygo generate` alone and beside each of them in turn, round by round, so that other work on the machine meets
all alike. Samples/s are those between the first and the last report of progress that names samples; processor time is
that of the fleet's processes alone, once the run is over, and tells on a busy machine as well. A frozen process is
stopped (SIGSTOP) once it listens: it takes no processor time and reads nothing.
"""

import contextlib
import json
import resource
import signal
import statistics
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import tyro

from readygo.apps.fleet.token import new_token, with_token
from readygo.common.bus.zenoh_bus import ZenohBus, free_endpoint
from readygo.common.messages import StatusReply, topics
from readygo.runs.folder import RunFolder

JOINS_S = 8.0
"""What is given to those who shall be frozen, to start and to subscribe [s]."""
TOKEN = new_token()
POLL_S = 0.2
ALONE, MONITORS, FROZEN_MONITORS, FROZEN_TRAINER = "alone", "monitors", "frozen monitors", "frozen trainer"
KINDS = (ALONE, MONITORS, FROZEN_MONITORS, FROZEN_TRAINER)
WATCHER = (
    "import sys, threading\n"
    "from readygo.apps.monitor.link import Link, RunAddress\n"
    "from readygo.apps.monitor.watch import RunWatch\n"
    "watch = RunWatch()\n"
    "link = Link(watch, lambda: RunAddress(*sys.argv[1:]))\n"
    "link.start()\n"
    "threading.Event().wait()\n"
)
"""Hears all that `readygo monitor` hears."""
IDLE_TRAINER = (
    "from readygo.__main__ import main\n"
    "from readygo.services.trainer import live\n"
    "live.FIRST_EPISODES = 1_000_000\n"
    "main()\n"
)
"""`readygo`, whose trainer never has enough episodes to begin."""


def main(
    scene: str,
    /,
    *,
    avatars: Path | None = None,
    episodes: int = 8,
    workers: int = 1,
    monitors: int = 10,
    rounds: int = 2,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle, "embedded" or "embedded:SEED".
        avatars: Avatar file or folder of them; the embedded ones by default.
        episodes: Episodes per run.
        workers: Renderers.
        monitors: How many look on.
        rounds: Runs of each kind.
        json_output: Print JSON.
    """
    command = ["generate", scene, "--episodes", str(episodes), "--workers", str(workers)]
    command += ["--avatars", str(avatars)] if avatars else []
    found: dict[str, list[tuple[float, float]]] = {kind: [] for kind in KINDS}
    for _ in range(rounds):
        for kind, measured in found.items():
            with tempfile.TemporaryDirectory() as folder:
                samples_hz, cpu_s = measure(command, Path(folder), kind, monitors)
                measured.append((round(samples_hz, 2), round(cpu_s / episodes, 3)))
    rows = compared(found)
    if json_output:
        print(json.dumps({"rows": rows, "rounds": found}))
        return
    print(f"{'beside':16} {'samples/s':>10} {'of alone':>9} {'CPU s/episode':>14} {'of alone':>9}")
    for kind, row in rows.items():
        rate = f"{row['samples_hz']:10.1f} {row['rate_ratio']:9.3f}"
        print(f"{kind:16} {rate} {row['cpu_s']:14.2f} {row['cpu_ratio']:9.3f}")


def compared(found: dict[str, list[tuple[float, float]]]) -> dict[str, dict[str, float]]:
    """Medians of samples/s and of processor time per episode by kind, and what they are of those alone."""
    medians = {kind: tuple(map(statistics.median, zip(*rows, strict=True))) for kind, rows in found.items()}
    alone_hz, alone_s = medians[ALONE]
    return {
        kind: {
            "samples_hz": samples_hz,
            "rate_ratio": round(samples_hz / alone_hz, 3),
            "cpu_s": cpu_s,
            "cpu_ratio": round(cpu_s / alone_s, 3),
        }
        for kind, (samples_hz, cpu_s) in medians.items()
    }


def measure(command: list[str], folder: Path, kind: str, monitors: int) -> tuple[float, float]:
    """Samples/s of one run, and the processor time of its processes [s]."""
    endpoint, data, log = free_endpoint(), folder / "data", folder / "fleet.log"
    before_s = _children_s()
    with _readygo([*command, "--out", str(data), "--listen", endpoint], log) as fleet:
        while not (RunFolder(data).state / "endpoint").exists() and fleet.poll() is None:
            time.sleep(POLL_S)
        with _beside(kind, endpoint, data, folder, monitors):
            heard = _heard(endpoint, data, fleet)
            # Those beside it still run: they do not count yet.
            after_s = _children_s()
    if fleet.returncode or len(heard) < 2:
        raise SystemExit(log.read_text() or "Too few episodes to measure: give more --episodes.")
    (begin_s, first), (end_s, last) = heard[0], heard[-1]
    return (last - first) / (end_s - begin_s), after_s - before_s


def _children_s() -> float:
    """Processor time of the processes that were waited for, with theirs [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def _heard(endpoint: str, data: Path, fleet: subprocess.Popen[bytes]) -> list[tuple[float, int]]:
    """Times and sample counts that the coordinator told, until the fleet ends."""
    heard: list[tuple[float, int]] = []

    def hear(status: StatusReply) -> None:
        if status.samples and (not heard or status.samples > heard[-1][1]):
            heard.append((time.monotonic(), status.samples))

    if fleet.poll() is None:
        bus = ZenohBus(endpoint, RunFolder(data).load()[0].run, TOKEN)
        bus.subscribe(topics.PROGRESS, hear)
        fleet.wait()
        bus.close()
    return heard


@contextlib.contextmanager
def _beside(kind: str, endpoint: str, data: Path, folder: Path, monitors: int) -> Iterator[None]:
    """Have some look on."""
    logs = [folder / f"beside{number}.log" for number in range(monitors if kind in (MONITORS, FROZEN_MONITORS) else 1)]
    run = RunFolder(data).load()[0].run
    with contextlib.ExitStack() as ended:
        processes = []
        for log in logs if kind != ALONE else ():
            if kind == FROZEN_TRAINER:
                process = _trainer(endpoint, run, data, folder, log)
            else:
                process = _start([sys.executable, "-c", WATCHER, endpoint, run, TOKEN], log)
            ended.callback(process.wait)
            ended.callback(process.kill)
            processes.append((process, log))
        if kind in (FROZEN_MONITORS, FROZEN_TRAINER):
            time.sleep(JOINS_S)
            for process, log in processes:
                if process.poll() is not None:
                    raise SystemExit(log.read_text())
                process.send_signal(signal.SIGSTOP)
        yield


def _trainer(endpoint: str, run: str, data: Path, folder: Path, log: Path) -> subprocess.Popen[bytes]:
    """A live trainer that subscribes, and never trains."""
    command = ["train", "--live", endpoint, "--run", run, str(data), "--out", str(folder / "policy")]
    return _start([sys.executable, "-c", IDLE_TRAINER, *command], log)


def _readygo(arguments: list[str], log: Path) -> subprocess.Popen[bytes]:
    return _start([sys.executable, "-m", "readygo", *arguments], log)


def _start(command: list[str], log: Path) -> subprocess.Popen[bytes]:
    with log.open("wb") as out:
        return subprocess.Popen(command, stdout=out, stderr=out, env=with_token(TOKEN))


if __name__ == "__main__":
    tyro.cli(main)
