"""Memory of each worker of a local fleet while it records: what it holds alone, and what it shares.

    python -m readygo.benchmarks.recording.memory scenes/lobby --avatars AVATARS --episodes 8 --workers 2

Runs `readygo generate` and reads /proc/PID/smaps_rollup of every worker (Linux) twice a second. Private memory is what
one more worker costs, in the end and at most (the first renderer packs what the others map); the rest is mapped files
that all workers of a host share, such as packed scenes.
"""

import json
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Annotated, Literal

import tyro

PERIOD_S = 0.5
FIELDS = {"private_mb": ("Private_Clean", "Private_Dirty"), "resident_mb": ("Rss",)}
Reading = dict[str, float]


def main(
    scene: str,
    /,
    *,
    avatars: Path | None = None,
    episodes: int = 8,
    workers: int = 2,
    detail: Literal["exact", "lod"] = "exact",
    json_output: Annotated[bool, tyro.conf.arg(name="json")] = False,
) -> None:
    """Measure.

    Args:
        scene: Scene bundle, "embedded", or "embedded:SEED".
        avatars: Avatar file or folder of them; the embedded ones by default.
        episodes: Episodes to record.
        workers: Renderers.
        detail: Level of detail.
        json_output: Print JSON.
    """
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-m", "readygo", "generate", scene, "--out", f"{folder}/data", "--json"]
        command += ["--episodes", str(episodes), "--workers", str(workers), "--renderer.detail", detail]
        command += ["--avatars", str(avatars)] if avatars else []
        with subprocess.Popen(command, stdout=subprocess.DEVNULL) as run:
            readings = _watched(run)
        if run.returncode:
            raise SystemExit(run.returncode)
    if json_output:
        print(json.dumps(readings))
        return
    print(f"{'worker':16} {'private':>8} {'at most':>8} {'resident':>9}  [MB]")
    for name, reading in sorted(readings.items()):
        print(f"{name:16} {reading['private_mb']:8.0f} {reading['most_mb']:8.0f} {reading['resident_mb']:9.0f}")


def _watched(run: subprocess.Popen[bytes]) -> dict[str, Reading]:
    """The last reading of each worker while a process runs, with the most private memory of all its readings."""
    readings: dict[str, Reading] = {}
    while run.poll() is None:
        for pid, name in workers_below(run.pid):
            reading = reading_of(pid)
            if reading is not None:
                most_mb = max(reading["private_mb"], readings.get(name, {}).get("most_mb", 0.0))
                readings[name] = {**reading, "most_mb": most_mb}
        time.sleep(PERIOD_S)
    return readings


def workers_below(ancestor: int) -> list[tuple[int, str]]:
    """Process numbers and names of the workers that a process has started, itself or by its fork server."""
    parents: dict[int, int] = {}
    workers = []
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            words = (folder / "cmdline").read_bytes().decode(errors="replace").replace("\0", " ").split()
            fields = (folder / "stat").read_text().rpartition(")")[2].split()
        except OSError:
            continue
        pid = int(folder.name)
        parents[pid] = int(fields[1])
        if "worker" in words:
            role = words[words.index("worker") + 1]
            workers.append((pid, words[words.index("--name") + 1] if "--name" in words else role))
    return [(pid, name) for pid, name in workers if ancestor in (parents[pid], parents.get(parents[pid]))]


def reading_of(pid: int) -> Reading | None:
    """Memory of a process [MB]; None once it has ended."""
    try:
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text().splitlines()[1:]
    except OSError:
        return None
    sizes_kb = {line.split(":")[0]: float(line.split()[1]) for line in lines}
    return {key: sum(sizes_kb[name] for name in names) / 1024 for key, names in FIELDS.items()} if sizes_kb else None


if __name__ == "__main__":
    tyro.cli(main)
