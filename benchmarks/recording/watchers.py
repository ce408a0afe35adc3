"""What watchers cost a fleet: processor time for each recorded episode with subscribers to all streams, against none.

    python -m readygo.benchmarks.recording.watchers embedded --episodes 12 --rounds 2

Runs `readygo generate` alternately alone and with subscribers in processes of their own, which hear all that
`readygo monitor` hears. Processor time is that of the fleet's processes alone, once the run is over: it tells on a
busy machine as well. The same episodes are made each time.
"""

import contextlib
import json
import resource
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
from readygo.apps.run.folder import RunFolder
from readygo.common.bus.zenoh_bus import free_endpoint

TOKEN = new_token()
POLL_S = 0.2
WATCHER = (
    "import sys, threading\n"
    "from readygo.apps.monitor.link import Address, Link\n"
    "from readygo.apps.monitor.watch import Watch\n"
    "watch = Watch()\n"
    "link = Link(watch, lambda: Address(*sys.argv[1:]))\n"
    "link.start()\n"
    "threading.Event().wait()\n"
)


def main(
    scene: str,
    /,
    *,
    episodes: int = 12,
    workers: int = 1,
    watchers: int = 10,
    rounds: int = 2,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle, "embedded" or "embedded:SEED".
        episodes: Episodes per run.
        workers: Renderers.
        watchers: Subscribers.
        rounds: Runs of either kind.
        json_output: Print JSON.
    """
    command = ["generate", scene, "--episodes", str(episodes), "--workers", str(workers)]
    taken: dict[str, list[float]] = {"alone": [], "watched": []}
    for _ in range(rounds):
        for kind, measured in taken.items():
            with tempfile.TemporaryDirectory() as folder:
                cpu_s = _cpu_s(command, Path(folder), watchers if kind == "watched" else 0)
                measured.append(round(cpu_s / episodes, 3))
    medians = {kind: statistics.median(measured) for kind, measured in taken.items()}
    result = {"cpu_s_per_episode": medians, "ratio": round(medians["watched"] / medians["alone"], 3), "rounds": taken}
    if json_output:
        print(json.dumps(result))
        return
    print(
        f"alone {medians['alone']:.2f} s, with {watchers} watchers {medians['watched']:.2f} s: {result['ratio']} of it"
    )


def _cpu_s(command: list[str], folder: Path, watchers: int) -> float:
    """Processor time of a run's processes [s]."""
    endpoint, data, log = free_endpoint(), folder / "data", folder / "fleet.log"
    before_s = _children_s()
    with log.open("wb") as out:
        arguments = [sys.executable, "-m", "readygo", *command, "--out", str(data), "--listen", endpoint]
        fleet = subprocess.Popen(arguments, stdout=out, stderr=out, env=with_token(TOKEN))
        while not (RunFolder(data).state / "endpoint").exists() and fleet.poll() is None:
            time.sleep(POLL_S)
        with _watched(endpoint, data, watchers):
            fleet.wait()
            # The watchers still run: they do not count yet.
            after_s = _children_s()
    if fleet.returncode:
        raise SystemExit(log.read_text())
    return after_s - before_s


def _children_s() -> float:
    """Processor time of the processes that were waited for, with theirs [s]."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


@contextlib.contextmanager
def _watched(endpoint: str, data: Path, watchers: int) -> Iterator[None]:
    """Subscribers to everything of a run."""
    command = [sys.executable, "-c", WATCHER, endpoint, RunFolder(data).load()[0].run, TOKEN] if watchers else []
    processes = [subprocess.Popen(command) for _ in range(watchers)]
    try:
        yield
    finally:
        for process in processes:
            process.kill()
            process.wait()


if __name__ == "__main__":
    tyro.cli(main)
