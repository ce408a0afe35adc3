"""What a fleet records beside a live trainer that does not move any more, next to the same fleet alone.

    python -m readygo.benchmarks.recording.frozen_trainer SCENE --avatars AVATARS --episodes 24 --rounds 3

Runs `readygo generate` alternately alone and beside `readygo train --live`, which is stopped (SIGSTOP) as soon as it
listens, so that it takes no processor time and reads nothing. Samples/s are those between the first and the last report
of progress that names samples.
"""

import contextlib
import json
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

from readygo.apps.run.folder import RunFolder
from readygo.common.bus.zenoh_bus import ZenohBus, free_endpoint
from readygo.common.messages import StatusReply, topics

JOINS_S = 8.0
"""What a trainer is given to start and to subscribe."""
POLL_S = 0.2


def main(
    scene: str,
    /,
    *,
    avatars: Path | None = None,
    episodes: int = 24,
    workers: int = 2,
    rounds: int = 3,
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle, "embedded" or "embedded:SEED".
        avatars: Avatar file or folder of them; the embedded ones by default.
        episodes: Episodes per run.
        workers: Renderers.
        rounds: Runs of either kind.
        json_output: Print JSON.
    """
    command = ["generate", scene, "--episodes", str(episodes), "--workers", str(workers)]
    command += ["--avatars", str(avatars)] if avatars else []
    rates: dict[str, list[float]] = {"alone": [], "frozen": []}
    for _ in range(rounds):
        for kind, measured in rates.items():
            with tempfile.TemporaryDirectory() as folder:
                measured.append(_samples_hz(command, Path(folder), frozen=kind == "frozen"))
    medians = {kind: round(statistics.median(measured), 2) for kind, measured in rates.items()}
    result = {"samples_hz": medians, "ratio": round(medians["frozen"] / medians["alone"], 3), "rounds": rates}
    if json_output:
        print(json.dumps(result))
        return
    print(f"alone {medians['alone']}/s, beside a frozen trainer {medians['frozen']}/s: {result['ratio']} of it")


def _samples_hz(command: list[str], folder: Path, *, frozen: bool) -> float:
    """Samples/s of one run."""
    endpoint, data = free_endpoint(), folder / "data"
    with _readygo([*command, "--out", str(data), "--listen", endpoint], folder / "fleet.log") as fleet:
        _wait_for(RunFolder(data).state, fleet)
        run = RunFolder(data).load()[0].run
        with _frozen_trainer(endpoint, run, data, folder) if frozen else contextlib.nullcontext():
            heard = _heard(endpoint, run, fleet)
    if fleet.returncode or len(heard) < 2:
        raise SystemExit((folder / "fleet.log").read_text() or "Too few episodes to measure: give more --episodes.")
    (begin_s, before), (end_s, after) = heard[0], heard[-1]
    return (after - before) / (end_s - begin_s)


def _heard(endpoint: str, run: str, fleet: subprocess.Popen[bytes]) -> list[tuple[float, int]]:
    """Times and sample counts that the coordinator told, until the fleet ends."""
    heard: list[tuple[float, int]] = []

    def hear(status: StatusReply) -> None:
        if status.samples and (not heard or status.samples > heard[-1][1]):
            heard.append((time.monotonic(), status.samples))

    bus = ZenohBus(endpoint, run)
    bus.subscribe(topics.PROGRESS, hear)
    fleet.wait()
    bus.close()
    return heard


@contextlib.contextmanager
def _frozen_trainer(endpoint: str, run: str, data: Path, folder: Path) -> Iterator[None]:
    """A live trainer that subscribes, never trains, and is stopped."""
    settings = folder / "trainer.toml"
    settings.write_text("[live]\nfirst_episodes = 1000000\n")
    command = ["train", "--live", endpoint, "--run", run, str(data), "--out", str(folder / "policy")]
    with _readygo([*command, "--config", str(settings)], folder / "trainer.log") as trainer:
        time.sleep(JOINS_S)
        if trainer.poll() is not None:
            raise SystemExit((folder / "trainer.log").read_text())
        trainer.send_signal(signal.SIGSTOP)
        yield
        trainer.kill()


def _readygo(arguments: list[str], log: Path) -> subprocess.Popen[bytes]:
    with log.open("wb") as out:
        return subprocess.Popen([sys.executable, "-m", "readygo", *arguments], stdout=out, stderr=out)


def _wait_for(state: Path, fleet: subprocess.Popen[bytes]) -> None:
    while not (state / "wanted").exists() and fleet.poll() is None:
        time.sleep(POLL_S)


if __name__ == "__main__":
    tyro.cli(main)
