"""Reports of mutation runs: written after every change, continued after an interruption, compared with earlier ones."""

import dataclasses
import json
import math
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.mutants.operators import Mutation
from tests.mutants.trial import TestRun, Trial

KILLED = ("killed", "timeout")
KEY = ("file", "function", "operator", "before", "after")
EQUIVALENTS = Path(__file__).with_name("equivalents.json")
"""Changes that a reviewer found to change nothing that counts: the keys of a change, and the reason."""

Entry = dict[str, Any]


class Report:
    """What a run has found so far."""

    def __init__(self, header: Mapping[str, Any], path: Path | None, equivalents: Sequence[Entry] = ()) -> None:
        self.header = dict(header)
        self.entries: list[Entry] = []
        self.unchanged: dict[str, TestRun] = {}
        self._path = path
        self._equivalent = {key_of(entry): entry["reason"] for entry in equivalents}

    def resume(self) -> None:
        """Take over what an interrupted run of the same kind left.

        Raises:
            ValueError: If the file is that of another run.
        """
        if self._path is None or not self._path.exists():
            return
        stored = json.loads(self._path.read_text())
        other = [name for name, value in self.header.items() if stored.get(name) != value]
        if other:
            raise ValueError(
                f"{self._path} is the report of another run ({', '.join(other)} differ); name another file with --out."
            )
        self.entries = stored["mutants"]
        self.unchanged = {test: TestRun(**run) for test, run in stored["unchanged"].items()}

    def has(self, mutation: Mutation) -> bool:
        """True if a change was tried out."""
        return any((key_of(entry), entry["line"]) == (mutation.key, mutation.line) for entry in self.entries)

    def add(self, mutation: Mutation, trial: Trial) -> Entry:
        """Add what became of a change, and write the file."""
        entry = {name: getattr(mutation, name) for name in ("file", "line", *KEY[1:])} | dataclasses.asdict(trial)
        if mutation.key in self._equivalent:
            entry["equivalent"] = self._equivalent[mutation.key]
        self.entries.append(entry)
        self.write()
        return entry

    def write(self) -> None:
        """Write the file, whole or not at all."""
        if self._path is None:
            return
        unchanged = {test: dataclasses.asdict(run) for test, run in self.unchanged.items()}
        content = {**self.header, "summary": self.summary(), "mutants": self.entries, "unchanged": unchanged}
        part = self._path.with_name(self._path.name + ".part")
        part.write_text(json.dumps(content, indent=1) + "\n")
        os.replace(part, self._path)

    def summary(self) -> dict[str, float]:
        """Counts by result, and the share of killed ones; equivalents do not count."""
        counts = Counter("equivalent" if "equivalent" in entry else entry["result"] for entry in self.entries)
        judged = sum(counts.values()) - counts["equivalent"]
        killed = sum(counts[name] for name in KILLED)
        names = ("killed", "timeout", "survived", "no test", "equivalent")
        return {name: counts[name] for name in names} | {"share_killed": round(killed / judged, 4) if judged else 1.0}


def key_of(entry: Mapping[str, Any]) -> tuple[Any, ...]:
    """Tells a change from others, also after lines above it have moved."""
    return tuple(entry[name] for name in KEY)


def fallen(report: Report, baseline: Mapping[str, Any], *, same: bool) -> list[str]:
    """What is worse than in an earlier report, a line each.

    Args:
        report: The new one.
        baseline: The earlier one.
        same: True if both tried out the same changes; otherwise a share may differ by twice its sampling error.
    """
    before = {key_of(entry): entry["result"] for entry in baseline["mutants"]}
    lines = [
        f"{entry['file']}:{entry['line']}: was killed before, survives now: {entry['after']}"
        for entry in report.entries
        if entry["result"] not in KILLED and before.get(key_of(entry)) in KILLED
    ]
    was, now = baseline["summary"]["share_killed"], report.summary()["share_killed"]
    counts = [max(1, len(entries)) for entries in (baseline["mutants"], report.entries)]
    error = 0.0 if same else 2 * math.sqrt(was * (1 - was) * sum(1 / count for count in counts))
    if now < was - error - 1e-9:
        lines.append(f"{now:.1%} of the mutants are killed, {was:.1%} were.")
    return lines
