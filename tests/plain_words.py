"""Finds phrases that the project does not use, in documents, docstrings, comments and messages: `make check` runs it.

    python tests/plain_words.py [FILE ...]

Each phrase stands for a plainer one; write that, or name who acts (the client, the worker, the user, the process).
"""

import io
import re
import subprocess
import sys
import tokenize
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).resolve().parents[1]
PHRASES = {
    r"whoever|whichever|whatever": "name who or what it is: any client, every worker, all inputs",
    r"nobody|somebody|anybody": "name the actor: no client, a user, another process",
    r"anew": "again, or: from the start",
    r"of (?:its|their|his|one's|our) own": "its own ..., separate, dedicated",
    r"go(?:es|ne|ing)? on|went on": "continues, resumes",
    r"in place of": "instead of",
    r"as good as": "almost, nearly",
    r"by choice": "optionally",
}
"""What to write instead, by phrase, in documents and sources."""
DOCUMENT_PHRASES = {
    r"as it goes|as they go": "during the run",
    r"of today": "current",
    r"(?:is|are) (?:said|told)(?! apart)": "is reported, printed, shown",
    r"costs? one line": "prints one line",
    r"own motion": "ego-motion",
    r"telephones?": "phone, video",
    r"dear(?:er)?": "of high cost",
    r"mend(?:ed|s|ing)?": "repair, correct",
    r"says? what (?:it|they|he|she) would": "labels",
    r"of another seed": "a different procedural apartment (seed 1)",
    r"films(?!/)": "videos",
    r"length of the way|way left": "path length, remaining distance",
    r"nothing asks for": "not enforced",
    r"who(?: is|ever is)? (?:slow|late)": "slow or late subscribers",
    r"no (?:one|body) (?:knows|asks|says)": "name the actor",
    r"it is (?:shown|made) to": "name the actor",
    r"(?:things?|humans?|people) (?:that|who) (?:is|are) none": "not treated as",
}
"""Phrases of documents alone; in sources some of them are names or data."""
DATA = {
    "apps/report/coverage_numbers.py": "nobody",
    "apps/report/coverage_run.py": "nobody",
    "apps/export/common.py": "anybody",
}
"""Words that are part of recorded or exported data, by file."""
FOLDERS = ("apps", "benchmarks", "common", "deploy", "docs", "examples", "experiments", "readygo", "runs", "services")
EXEMPT = ("CHANGELOG.md",)
"""What was once written stays."""
GENERATED = ("docs/commands.md", "docs/tables.md")
"""Documents that repeat what sources and results say."""


class Found(NamedTuple):
    """A phrase and where it stands."""

    line: int
    phrase: str


def pattern_of(phrases: Iterable[str]) -> re.Pattern[str]:
    """Any of the phrases; a line break may part one."""
    return re.compile(rf"(?<!/)\b(?:{'|'.join(phrases)})\b".replace(" ", r"\s+"), re.IGNORECASE)


PATTERN = pattern_of(PHRASES)
DOCUMENT_PATTERN = pattern_of({**PHRASES, **DOCUMENT_PHRASES})


def phrases_in(text: str, first_line: int = 1, pattern: re.Pattern[str] = PATTERN) -> Iterator[Found]:
    """The phrases of a text.

    Args:
        text: Some lines.
        first_line: Number of the first of them.
        pattern: What to look for.
    """
    for match in pattern.finditer(text):
        yield Found(first_line + text.count("\n", 0, match.start()), " ".join(match.group().split()))


def words_of_source(source: str) -> Iterator[tuple[int, str]]:
    """Comments and texts of a Python source, each with its first line."""
    texts = {tokenize.COMMENT, tokenize.STRING, getattr(tokenize, "FSTRING_MIDDLE", -1)}
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type in texts:
            yield token.start[0], token.string


def find(path: Path) -> list[Found]:
    """The phrases of a document or a source file."""
    text = path.read_text()
    if path.suffix != ".py":
        is_generated = path.is_relative_to(ROOT) and path.relative_to(ROOT).as_posix() in GENERATED
        return list(phrases_in(text, pattern=PATTERN if is_generated else DOCUMENT_PATTERN))
    return [found for line, part in words_of_source(text) for found in phrases_in(part, line)]


def checked_files() -> list[Path]:
    """Documents, and the product's sources."""
    listed = subprocess.run(["git", "ls-files", "*.md", "*.py"], cwd=ROOT, capture_output=True, text=True, check=True)
    names = [name for name in listed.stdout.splitlines() if name not in EXEMPT]
    return [ROOT / name for name in names if "/" not in name or name.startswith(tuple(f"{f}/" for f in FOLDERS))]


def instead_of(phrase: str) -> str:
    """What to write instead of a phrase."""
    return next(
        words
        for pattern, words in {**PHRASES, **DOCUMENT_PHRASES}.items()
        if re.fullmatch(pattern, phrase, re.IGNORECASE)
    )


def main(names: list[str]) -> int:
    """Print what was found; 1 if there is something."""
    paths = [Path(name) for name in names] or checked_files()
    lines = [
        f"{path.relative_to(ROOT) if path.is_relative_to(ROOT) else path}:{line}: {phrase!r}: {instead_of(phrase)}"
        for path in paths
        for line, phrase in find(path)
        if not (path.is_relative_to(ROOT) and DATA.get(path.relative_to(ROOT).as_posix()) == phrase)
    ]
    sys.stdout.write("".join(f"{line}\n" for line in lines) + f"{len(lines)} phrases to be said more plainly\n")
    return 1 if lines else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
