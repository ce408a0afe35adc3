"""`readygo bench chaos`: a run among random faults, compared with the same run left alone.

A seed fixes what goes wrong, after how many durable episodes, and how long it lasts; which process or file it hits also
depends on what is there at that moment. The run is started again whenever it ends early, as a service manager would do.
"""

import contextlib
import ctypes
import json as json_module
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Iterator
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from readygo.benchmarks.fleet.faults import Fault, Trace, bring_about, schedule
from readygo.benchmarks.fleet.site import DataSite, run_to_end
from readygo.benchmarks.rasterizer.render import machine
from readygo.common.dataset import Report, validate
from readygo.common.dataset.index import load_index
from readygo.common.errors import ConfigError, DatasetError
from readygo.runs.folder import RunFolder

POLL_S = 0.1
PATIENCE_S = 180.0
"""Time that a fault waits for something that it can hit, such as a worker while the fleet starts [s]."""
ORPHAN_S = 10.0
"""Time that processes have to end after their run [s]."""
SETTINGS = """
[robot.camera]
height_px = 48
width_px = 64

[episode]
goal_distance_min_m = 2.0
goal_distance_max_m = 4.0

[recorder]
episodes_per_shard = 8

[coordinator]
lease_s = 5.0
recorders = ["rec0", "rec1", "rec2"]
"""
"""Small images, so that processes and their protocol are most of the work; small shards, so that there are many."""


@dataclass(kw_only=True)
class ChaosOutcome:
    """What the disturbed run has, beside what it should have."""

    episodes: int = 0
    missing: list[int] = field(default_factory=list)
    double: list[int] = field(default_factory=list)
    torn: list[str] = field(default_factory=list)
    """Defects that `validate` finds, and files that a finished run should not have."""
    wrong: list[int] = field(default_factory=list)
    """Episodes whose bytes are others, or that the run left alone has not."""
    orphans: int = 0
    """Processes that outlive the run."""

    @property
    def ok(self) -> bool:
        """True if nothing is wrong."""
        return not (self.missing or self.double or self.torn or self.wrong or self.orphans)


@dataclass(frozen=True, kw_only=True)
class BenchChaosOptions:
    """Record a run among random faults, and compare it with the same run left alone, in one process.

    Workers, recorders, coordinator and launcher are killed, stopped and ended; blobs, shards and the ledger are damaged
    and removed, the disk is full, strangers lie. Exits with 2 if an episode is missing, double, torn or wrong.
    """

    scene: str = "embedded"
    """Scene bundle, "embedded", or "embedded:SEED"."""
    episodes: int = 500
    """Episodes to record."""
    faults: int = 200
    """Faults meanwhile."""
    workers: int = 2
    """Renderers."""
    seed: int = 0
    """Seed of the faults and of the run."""
    longest_s: float = 12.0
    """Longest time that a process is stopped or a disk full [s]."""
    disk_mib: int = 1024
    """Size of the disk in memory that the data are on, for full disks; without the right to mount one, or with 0,
    these faults are skipped [MiB]."""
    folder: Path | None = None
    """Keep data and logs here; a temporary folder by default."""
    json: bool = False
    """Print JSON."""


def bench_chaos(options: BenchChaosOptions) -> None:
    """Record a run among random faults, and compare it with the same run left alone, in one process."""
    if options.episodes < 1 or options.faults < 0 or options.longest_s <= 0.3:
        raise ConfigError("--episodes must be at least 1, --faults at least 0 and --longest-s above 0.3.")
    with contextlib.ExitStack() as stack:
        place = options.folder or Path(stack.enter_context(tempfile.TemporaryDirectory()))
        place.mkdir(parents=True, exist_ok=True)
        own = "".join(f"{name} = {json_module.dumps(str(place / name))}\n" for name in ("rec1", "rec2"))
        command = ["generate", options.scene, "--episodes", str(options.episodes), "--seed", str(options.seed)]
        # In one process: the bytes are the same, and no fleet has to start.
        alone = [*command, "--workers", "0", "--config", _settings(place / "alone.toml", SETTINGS)]
        alone_s = _undisturbed(alone, place)
        command += ["--config", _settings(place / "settings.toml", f"{SETTINGS}\n[coordinator.folders]\n{own}")]
        command += ["--workers", str(options.workers)]
        disk = stack.enter_context(small_disk(place / "data", options.disk_mib))
        planned = schedule(options.episodes, options.faults, options.seed, longest_s=options.longest_s)
        begin_s = time.monotonic()
        site = DataSite([*command, "--out", str(place / "data")], RunFolder(place / "data"), place / "chaos.log")
        traces = disturb(site, planned, place / "faults.log")
        outcome = compare([place / "alone"], site.places(), validate(place / "data"))
        outcome.orphans = _orphans(site)
        if options.folder and disk and not outcome.ok:
            shutil.copytree(place / "data", place / "found")
        result = report(traces, outcome, site)
        result |= {"alone_s": round(alone_s, 1), "wall_s": round(time.monotonic() - begin_s, 1), "small_disk": disk}
    sys.stdout.write((json_module.dumps(result) if options.json else _text(result)) + "\n")
    if not outcome.ok or site.hung:
        raise DatasetError("The disturbed run is not what it should be.")


def _settings(path: Path, text: str) -> str:
    path.write_text(text)
    return str(path)


def _undisturbed(command: list[str], place: Path) -> float:
    """Record the same run in peace; returns how long that took [s]."""
    site = DataSite([*command, "--out", str(place / "alone")], RunFolder(place / "alone"), place / "alone.log")
    begin_s = time.monotonic()
    site.start()
    run_to_end(site, patience_s=24 * 3600.0, runs_max=0)
    return time.monotonic() - begin_s


@contextlib.contextmanager
def small_disk(folder: Path, size_mib: int) -> Iterator[bool]:
    """Put a folder on a small disk in memory where that is allowed; yields whether it was."""
    folder.mkdir(parents=True, exist_ok=True)
    libc = ctypes.CDLL(None, use_errno=True)
    size = f"size={size_mib}m".encode()
    mounted = bool(size_mib) and libc.mount(b"tmpfs", str(folder).encode(), b"tmpfs", 0, size) == 0
    try:
        yield mounted
    finally:
        if mounted:
            libc.umount2(str(folder).encode(), 2)


def disturb(site: DataSite, faults: list[Fault], log: Path) -> list[tuple[Fault, Trace]]:
    """Do a run while faults happen; afterwards all is recorded, or the run does not end.

    Raises:
        RunError: If the run does not end when nothing disturbs it any more.
    """
    traces: list[tuple[Fault, Trace]] = []
    lasting: list[tuple[float, Trace]] = []
    waiting, since_s = list(faults), time.monotonic()
    site.start()
    try:
        with log.open("w") as lines:
            while waiting or lasting:
                time.sleep(POLL_S)
                lasting = _ended(lasting)
                if over := site.keep_up():
                    site.start()
                if not waiting or not (over or site.durable() >= waiting[0].after):
                    since_s = time.monotonic()
                    continue
                fault, waited_s = waiting[0], time.monotonic() - since_s
                if waited_s < fault.delay_s:
                    continue
                trace = bring_about(site, fault)
                # Nothing comes any more that it could hit if the run is over.
                if trace.later and waited_s < PATIENCE_S and not over:
                    continue
                waiting.pop(0)
                since_s = time.monotonic()
                traces.append((fault, trace))
                lines.write(f"{since_s:.1f} {site.durable()} {fault.kind.name} {trace.words}\n")
                lines.flush()
                lasting += [(since_s + fault.duration_s, trace)] if trace.undo else []
        run_to_end(site, patience_s=1800.0)
        # Once more: what was damaged after the last look is mended.
        site.start()
        run_to_end(site, patience_s=1800.0)
    finally:
        if sys.exc_info()[0]:
            site.stop()
    return traces


def _ended(lasting: list[tuple[float, Trace]]) -> list[tuple[float, Trace]]:
    """End the faults whose time is over; returns the others."""
    now_s = time.monotonic()
    for end_s, trace in lasting:
        if end_s <= now_s and trace.undo:
            trace.undo()
    return [(end_s, trace) for end_s, trace in lasting if end_s > now_s]


def compare(alone: list[Path], disturbed: list[Path], checked: Report) -> ChaosOutcome:
    """What of a disturbed run is not as in the same run left alone, by their folders and what `validate` says."""
    expected = {index: hashes[0] for index, hashes in _episodes(alone).items()}
    found = _episodes(disturbed)
    return ChaosOutcome(
        episodes=sum(map(len, found.values())),
        missing=sorted(set(expected) - set(found)),
        double=sorted(index for index, hashes in found.items() if len(hashes) > 1),
        torn=[*map(str, checked.defects), *(path.name for folder in disturbed for path in _unfinished(folder))],
        wrong=sorted(index for index, hashes in found.items() if set(hashes) != {expected.get(index)}),
    )


def _episodes(folders: list[Path]) -> dict[int, list[str]]:
    """SHA-256 of the episodes in finished shards, by index."""
    found: dict[int, list[str]] = {}
    for shard in (shard for folder in folders for shard in sorted(folder.glob("shard-*.mcap"))):
        for row in load_index(shard).episodes:
            found.setdefault(int(row["index"]), []).append(row["sha256"].decode())
    return found


def _unfinished(folder: Path) -> list[Path]:
    return [path for pattern in ("*.part", "*.salvage") for path in folder.glob(pattern)]


def _orphans(site: DataSite) -> int:
    deadline_s = time.monotonic() + ORPHAN_S
    while (left := site.left_behind()) and time.monotonic() < deadline_s:
        time.sleep(POLL_S)
    site.stop()
    return len(left)


def report(traces: list[tuple[Fault, Trace]], outcome: ChaosOutcome, site: DataSite) -> dict[str, Any]:
    """All of it as plain values."""
    happened = Counter(fault.kind.value for fault, trace in traces if not trace.skipped)
    skipped = Counter(f"{fault.kind.value}: {trace.words}" for fault, trace in traces if trace.skipped)
    believed = [trace.words for _, trace in traces if "BELIEVED" in trace.words]
    return {
        "machine": machine(),
        "ok": outcome.ok and not site.hung,
        **asdict(outcome),
        "faults": sum(happened.values()),
        "by_kind": dict(happened),
        "skipped": dict(skipped),
        "believed": believed,
        "hung": site.hung,
        "set_aside": {path.stem: path.read_text().strip() for path in sorted(site.folder.aside.glob("*.txt"))},
        "started_again": dict(Counter(site.reruns)),
    }


def _text(result: dict[str, Any]) -> str:
    lines = [
        f"{result['episodes']} episodes, {result['faults']} faults in {result['wall_s']} s "
        f"({result['alone_s']} s alone, in one process)"
    ]
    lines += [f"  {count:4} {kind}" for kind, count in result["by_kind"].items()]
    lines += [f"  {count:4} skipped: {kind}" for kind, count in result["skipped"].items()]
    lines += [f"  {count:4} started again: {words}" for words, count in result["started_again"].items()]
    lines += [f"  believed: {words}" for words in result["believed"]]
    lines += [f"  set aside: {episode}: {why}" for episode, why in result["set_aside"].items()]
    wrong = ("missing", "double", "torn", "wrong")
    lines.append(
        ", ".join(f"{name} {len(result[name])}" for name in wrong)
        + f", orphans {result['orphans']}, hung {result['hung']}"
    )
    return "\n".join(lines)
