"""Where a tree is changed: lines drawn at random, lines that a commit changed, or the changes of an earlier report."""

import random
import re
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from tests.mutants.operators import Mutation, find_mutations

TOPS = ("common", "services", "runs", "apps")
HAND = "hand"
"""Operator of changes that a person wrote: their `before` stands once in the file."""

Lines = Mapping[str, set[int] | None]
"""Lines that may be changed, by file; None for all."""


def tracked_files(root: Path) -> list[str]:
    """Files that git knows or would add, relative to `root`."""
    command = ("ls-files", "-z", "--cached", "--others", "--exclude-standard")
    return sorted({name for name in git(root, *command).split("\0") if name and (root / name).exists()})


def product_files(root: Path, files: Iterable[str]) -> list[str]:
    """Those of the product that may be changed: neither `__init__.py` nor generated ones."""
    found = (file for file in files if file.split("/")[0] in TOPS and file.endswith(".py"))
    return [file for file in found if not file.endswith(("/__init__.py", "/__main__.py", "_pb2.py"))]


def changed_lines(root: Path, base: str) -> dict[str, set[int]]:
    """Lines of the working tree that differ from a commit, by file."""
    lines: dict[str, set[int]] = {}
    file = ""
    for line in git(root, "diff", "-U0", "--no-color", "--no-ext-diff", base, "--", *TOPS).splitlines():
        if line.startswith("+++ "):
            file = line[6:]
        match = re.match(r"@@ -\S+ \+(\d+)(?:,(\d+))? @@", line)
        if match:
            first, count = int(match[1]), int(match[2] or 1)
            lines.setdefault(file, set()).update(range(first, first + count))
    for name in git(root, "ls-files", "-z", "--others", "--exclude-standard", "--", *TOPS).split("\0"):
        if name:
            lines[name] = set(range(1, len((root / name).read_bytes().splitlines()) + 1))
    return lines


def default_base(root: Path) -> str:
    """What daily work is compared with: where the branch left main, the latest tag, or the commit before."""
    for command in (
        ("merge-base", "HEAD", "main"),
        ("describe", "--tags", "--abbrev=0", "HEAD^"),
        ("rev-parse", "HEAD^"),
    ):
        try:
            base = git(root, *command).strip()
        except subprocess.CalledProcessError:
            continue
        if git(root, "rev-parse", base) != git(root, "rev-parse", "HEAD"):
            return base
    return "HEAD^"


def draw(root: Path, lines: Lines, count: int, seed: int) -> list[Mutation]:
    """At most `count` changes of distinct lines, all lines with a possible change alike likely.

    A line's kinds of changes are alike likely, too. The order is random: a part of the draw is a draw.
    """
    rng = random.Random(seed)
    places: dict[tuple[str, int], list[Mutation]] = {}
    for file, wanted in sorted(lines.items()):
        for mutation in find_mutations(file, (root / file).read_bytes()):
            if wanted is None or mutation.line in wanted:
                places.setdefault((file, mutation.line), []).append(mutation)
    order = list(places)
    rng.shuffle(order)
    found: list[Mutation] = []
    for place in order:
        if len(found) == count:
            break
        source = (root / place[0]).read_bytes()
        chosen = next((one for one in _shuffled(places[place], rng) if one.compiles(source)), None)
        found += [chosen] if chosen else []
    return found


def _shuffled(mutations: Sequence[Mutation], rng: random.Random) -> list[Mutation]:
    """By kinds in random order, and at random within a kind."""
    kinds = sorted({one.operator for one in mutations})
    rng.shuffle(kinds)
    return [one for kind in kinds for one in rng.sample(list(mutations), len(mutations)) if one.operator == kind]


def known(root: Path, entries: Iterable[Mapping[str, Any]]) -> list[Mutation]:
    """The changes of a report that the tree still has a place for."""
    found = []
    for entry in entries:
        path = root / entry["file"]
        source = path.read_bytes() if path.is_file() else b""
        if entry["operator"] == HAND:
            found += _by_hand(entry, source)
        else:
            wanted = tuple(entry[name] for name in ("file", "function", "operator", "before", "after"))
            found += [one for one in find_mutations(entry["file"], source) if one.key == wanted][:1]
    return found


def _by_hand(entry: Mapping[str, Any], source: bytes) -> list[Mutation]:
    before = entry["before"].encode()
    if source.count(before) != 1:
        return []
    begin = source.index(before)
    return [
        Mutation(
            **{name: entry[name] for name in ("file", "function", "operator", "before", "after")},
            line=source.count(b"\n", 0, begin) + 1,
            begin=begin,
            end=begin + len(before),
            text=entry["after"],
        )
    ]


def git(root: Path, *arguments: str) -> str:
    """What a git command prints.

    Raises:
        subprocess.CalledProcessError: If it fails.
    """
    return subprocess.run(("git", *arguments), cwd=root, capture_output=True, text=True, check=True).stdout
