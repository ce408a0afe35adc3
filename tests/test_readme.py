"""What README and the other documents show works: Python runs, commands parse, options and settings exist."""

import collections
import functools
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.apps.cli import function_of, options_of, parse
from readygo.apps.export.formats import FORMATS
from readygo.apps.options import describe_options, section_groups
from readygo.commands import COMMANDS
from readygo.common.config import section_from_mapping
from readygo.runs.config import RunConfig
from tests.common.dataset.episodes import write_shard
from tests.common.policy.artifacts import write_policy

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [
    ROOT / "README.md",
    ROOT / "ARCHITECTURE.md",
    ROOT / "CHANGELOG.md",
    ROOT / "CONTRIBUTING.md",
    *sorted((ROOT / "docs").rglob("*.md")),
]
DOCUMENTS += sorted(
    path for top in ("services", "common", "benchmarks", "examples") for path in (ROOT / top).rglob("README.md")
)
NAMES = [path.relative_to(ROOT).as_posix() for path in DOCUMENTS]
README = (ROOT / "README.md").read_text()
SPAN = re.compile(r"`([^`]+)`")


def _examples() -> Iterator[tuple[str, str]]:
    """Python that a document shows, with the document's name."""
    for name in NAMES:
        for example in re.findall(r"^```python\n(.*?)^```", (ROOT / name).read_text(), re.MULTILINE | re.DOTALL):
            yield name, example


def _command_lines(text: str) -> Iterator[str]:
    """Calls of `readygo` in blocks, without their comments; square brackets enclose what may be left out."""
    for line in re.findall(r"^ {4}(readygo .*)$", text, re.MULTILINE):
        yield line.split(" #")[0].translate({ord(mark): " " for mark in "[]"}).replace("...", "")


@functools.cache
def _options(command: str) -> set[str]:
    """The options of a command, keys of its configuration included."""
    about = describe_options(options_of(function_of(COMMANDS[command])))
    groups = section_groups(about.sections, about.options) if about.sections else ()
    keys = {option.flag for group in groups for option in group.options}
    return {"--help", "--help-all"} | {option.flag for option in about.options} | keys


def _spans(name: str) -> list[str]:
    """What a document's sentences and tables show as code."""
    return SPAN.findall(" ".join((ROOT / name).read_text().split()))


@pytest.mark.parametrize(("name", "example"), list(_examples()))
def test_python_runs(name: str, example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    if "gymnasium" in example:
        pytest.importorskip("gymnasium", reason="gymnasium (extra gym) is not installed")
    write_shard(tmp_path / "out" / "data", [0, 1], labels=True)
    write_policy(tmp_path / "out" / "policy")
    monkeypatch.chdir(tmp_path)
    known = dict(FORMATS)
    try:
        exec(compile(example, name, "exec"), {})
    finally:
        FORMATS.clear()
        FORMATS.update(known)


def test_there_is_python_to_run() -> None:
    counts = collections.Counter(name for name, _ in _examples())
    assert counts == {"README.md": 2, "docs/extending.md": 7, "docs/own-policy.md": 1, "docs/python-api.md": 3}


@pytest.mark.parametrize("name", NAMES)
def test_commands_in_blocks_parse(name: str) -> None:
    for line in _command_lines((ROOT / name).read_text()):
        parse(COMMANDS, shlex.split(line)[1:])


@pytest.mark.parametrize("name", NAMES)
def test_commands_in_sentences_exist_with_their_options(name: str) -> None:
    for span in _spans(name):
        if span.startswith("readygo ") and not span.startswith("readygo --"):
            words = span.split()[1:3]
            command = next((known for known in (" ".join(words), words[0]) if known in COMMANDS), None)
            assert command, span
            used = re.findall(r"--[a-z](?:[a-z-]|\.[a-z])*", span.split(", and ")[0])
            assert set(used) <= _options(command), span


@pytest.mark.parametrize("name", NAMES)
def test_options_in_sentences_exist(name: str) -> None:
    known = set.union({"--version"}, *map(_options, COMMANDS))
    used = {span.split()[0].split("=")[0] for span in _spans(name) if re.match(r"--[a-z]", span)}
    assert sorted(used - known) == []


@pytest.mark.parametrize("name", NAMES)
def test_extras_and_programs_exist(name: str) -> None:
    text = (ROOT / name).read_text()
    extras = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["optional-dependencies"]
    named = re.findall(r'-e "\.\[([a-z,-]+)\]"', text) + re.findall(r'extras? [`"]([a-z-]+)[`"]', text)
    assert {extra for group in named for extra in group.split(",")} <= set(extras)
    for program in re.findall(r"python ((?:[a-z_]+/)+[a-z_]+\.py)", text):
        assert (ROOT / program).is_file(), program


@pytest.mark.parametrize("name", NAMES)
def test_settings_exist(name: str) -> None:
    for section, line in re.findall(r"`\[([a-z_.]+)\] ([a-z_]+ = [^`]+)`", (ROOT / name).read_text()):
        section_from_mapping(RunConfig, tomllib.loads(f"[{section}]\n{line}"))


def test_targets_of_make_exist() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"^ {4}make ([a-z]+)|`make ([a-z]+)`", README, re.MULTILINE)) >= {("demo", ""), ("", "docs")}
    used = {a or b for a, b in re.findall(r"^ {4}make ([a-z]+)|`make ([a-z]+)`", README, re.MULTILINE)}
    assert used <= targets
