"""Fuzzes every reader of bytes from elsewhere: `python -m tests.fuzz [--inputs 20000] [--only NAME] [--from N]`.

`--only NAME --from N --inputs 1` gives one input again. Exits with 1 if something was found.
"""

import argparse
import json
import multiprocessing
import multiprocessing.connection
import subprocess
import sys
from collections import deque
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from readygo.benchmarks.rasterizer.render import machine
from tests.fuzz.run import Counts, Target, as_mapping, fuzz, total

ROOT = Path(__file__).resolve().parents[2]


def all_targets() -> list[Target]:
    """Every reader."""
    from tests.fuzz import files, robots, runs

    return [*files.TARGETS, *runs.TARGETS, *robots.TARGETS]


def _fuzz(name: str, *, first: int, count: int, key: int, keep: Path | None) -> Counts:
    (target,) = (each for each in all_targets() if each.name == name)
    return fuzz(target, first, count, key=key, keep=keep)


def _in_turn(names: list[str], jobs: int, settings: Sequence[partial[Counts]]) -> Iterator[tuple[str, Counts]]:
    """All targets in every round, each in a process of its own: none inherits what another one has loaded.

    This process has no threads, as a pool would have: what is forked finds no lock that nobody will let go of.
    """
    context = multiprocessing.get_context("fork")
    tasks = deque((name, part) for part in settings for name in names)
    running: dict[Any, str] = {}
    while tasks or running:
        while tasks and len(running) < jobs:
            name, part = tasks.popleft()
            ours, theirs = context.Pipe(duplex=False)
            context.Process(target=_task, args=(theirs, name, part)).start()
            theirs.close()
            running[ours] = name
        for ready in multiprocessing.connection.wait(list(running)):
            name, counts = running.pop(ready), ready.recv()  # type: ignore[union-attr]
            ready.close()  # type: ignore[union-attr]
            yield name, counts


def _task(told: Any, name: str, part: partial[Counts]) -> None:
    told.send(part(name))


def _line(name: str, counts: Counts) -> str:
    found = f"{counts.tracebacks} tracebacks, {counts.crashes} crashes, {counts.above_memory} above 1 GB, "
    found += f"{counts.above_time} above 5 s"
    rate = f"{1000 * counts.seconds / max(counts.inputs, 1):.2f} ms, peak {counts.peak_mb:.0f} MB"
    begin = f"{name:<28} {counts.inputs:>8,}  accepted {counts.accepted:>7,}, refused {counts.refused:>7,}"
    kinds = [f"    {count:>6,}  {words}\n" for words, count in counts.findings.items()]
    return f"{begin}; {found}; {rate}\n{''.join(kinds)}"


def main() -> int:
    """Fuzz, and say what came of it."""
    parser = argparse.ArgumentParser(prog="python -m tests.fuzz", description=__doc__)
    parser.add_argument("--inputs", type=int, default=20_000, help="inputs for each target")
    parser.add_argument("--only", action="append", default=[], help="part of a target's name; may be given again")
    parser.add_argument("--from", type=int, default=0, dest="first", help="number of the first input")
    parser.add_argument("--seed", type=int, default=0, help="another one makes other inputs")
    parser.add_argument("--jobs", type=int, default=1, help="targets at a time")
    parser.add_argument("--findings", type=Path, help="folder for inputs that are findings")
    parser.add_argument("--out", type=Path, help="file for the counts as JSON, written after every target")
    parser.add_argument("--rounds", type=int, default=1, help="parts in which every target gets its inputs, in turn")
    given = parser.parse_args()
    names = [each.name for each in all_targets()]
    names = [name for name in names if not given.only or any(part in name for part in given.only)]
    size = -(-given.inputs // given.rounds)
    rounds = [
        partial(
            _fuzz, first=first, count=min(size, given.first + given.inputs - first), key=given.seed, keep=given.findings
        )
        for first in range(given.first, given.first + given.inputs, size)
    ]
    found = {name: Counts() for name in names}
    for name, counts in _in_turn(names, given.jobs, rounds):
        found[name].add(counts)
        if given.out is not None:
            given.out.write_text(_report(given.seed, found))
        if found[name].inputs >= given.inputs:
            sys.stdout.write(_line(name, found[name]))
            sys.stdout.flush()
    return 0 if all(counts.ok for counts in found.values()) else 1


def _report(seed: int, found: dict[str, Counts]) -> str:
    described = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=False)
    report = {
        "machine": machine(),
        "command": f"python -m tests.fuzz {' '.join(sys.argv[1:])}",
        "commit": described.stdout.strip(),
        "seed": seed,
        "total": total(found),
        "targets": as_mapping(found),
    }
    return json.dumps(report, indent=1) + "\n"


if __name__ == "__main__":
    sys.exit(main())
