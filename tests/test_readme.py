"""What README and the other documents show works: Python runs, commands parse, options and settings exist."""

import inspect
import re
import shlex
import tomllib
from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.apps.cli import parse
from readygo.apps.run.config import RunConfig
from readygo.commands import COMMANDS
from readygo.common.config import section_from_mapping
from tests.common.dataset.episodes import write_shard
from tests.common.policy.artifacts import write_policy

ROOT = Path(__file__).resolve().parents[1]
DOCUMENTS = [ROOT / "README.md", ROOT / "ARCHITECTURE.md", ROOT / "CHANGELOG.md", *sorted((ROOT / "docs").glob("*.md"))]
DOCUMENTS += sorted(
    path for top in ("services", "common", "benchmarks", "examples") for path in (ROOT / top).rglob("README.md")
)
NAMES = [path.relative_to(ROOT).as_posix() for path in DOCUMENTS]
README = (ROOT / "README.md").read_text()
SPAN = re.compile(r"`([^`]+)`")


def _examples() -> list[str]:
    return re.findall(r"^```python\n(.*?)^```", README, re.MULTILINE | re.DOTALL)


def _command_lines(text: str) -> Iterator[str]:
    """Calls of `readygo` in blocks, without their comments; square brackets enclose what may be left out."""
    for line in re.findall(r"^ {4}(readygo .*)$", text, re.MULTILINE):
        yield line.split(" #")[0].translate({ord(mark): " " for mark in "[]"}).replace("...", "")


def _options() -> set[str]:
    """Every option of every command."""
    import importlib

    found = {"--help", "--version"}
    for command in COMMANDS.values():
        module, name = command.path.split(":")
        parameters = inspect.signature(getattr(importlib.import_module(module), name)).parameters.values()
        found |= {f"--{p.name.replace('_', '-')}" for p in parameters if p.kind is p.KEYWORD_ONLY}
    return found


@pytest.mark.parametrize("example", _examples())
def test_python_runs(example: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_shard(tmp_path / "out" / "data", [0, 1], labels=True)
    write_policy(tmp_path / "out" / "policy")
    monkeypatch.chdir(tmp_path)
    exec(compile(example, "README.md", "exec"), {})


def test_there_is_python_to_run() -> None:
    assert len(_examples()) == 3


@pytest.mark.parametrize("name", NAMES)
def test_commands_in_blocks_parse(name: str) -> None:
    for line in _command_lines((ROOT / name).read_text()):
        parse(COMMANDS, shlex.split(line)[1:])


@pytest.mark.parametrize("name", NAMES)
def test_commands_in_sentences_exist(name: str) -> None:
    text = " ".join((ROOT / name).read_text().split())
    for span in SPAN.findall(text):
        if span.startswith("readygo "):
            words = span.split()[1:3]
            assert words[0] in COMMANDS or " ".join(words) in COMMANDS, span


def test_options_exist() -> None:
    options = _options()
    spans = [span for span in SPAN.findall(README) if span.startswith(("readygo ", "--"))]
    used = [option for span in spans for option in re.findall(r"--[a-z-]+", span)]
    assert used
    assert sorted(set(used) - options) == []


@pytest.mark.parametrize("name", NAMES)
def test_settings_exist(name: str) -> None:
    for section, line in re.findall(r"`\[([a-z_.]+)\] ([a-z_]+ = [^`]+)`", (ROOT / name).read_text()):
        section_from_mapping(RunConfig, tomllib.loads(f"[{section}]\n{line}"))


def test_targets_of_make_exist() -> None:
    targets = set(re.findall(r"^([a-z]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    assert set(re.findall(r"^ {4}make ([a-z]+)|`make ([a-z]+)`", README, re.MULTILINE)) >= {("demo", ""), ("", "docs")}
    used = {a or b for a, b in re.findall(r"^ {4}make ([a-z]+)|`make ([a-z]+)`", README, re.MULTILINE)}
    assert used <= targets
