"""Sweeps for tests, of a command that takes no time: `readygo evaluate` stands for it by a script."""

import json
import sys
from pathlib import Path
from typing import Any

import pytest

from readygo.apps.sweep import point
from readygo.apps.sweep.plan import Sweep, open_sweep

EVALUATE = """
command = "evaluate"
scenes = ["embedded", "embedded:1"]
seeds = [0, 1]

[options]
episodes = 3
methods = ["straight-line", "expert"]

[arms.calm.human_planner]
yielding = 1.0

[arms.paper]
people = "paper"
"""
LONGER = """
command = "evaluate"
scenes = ["embedded"]
seeds = [0, 1]

[options]
episodes = 40
tasks = ["dynamic"]
methods = ["straight-line"]

[arms.calm.human_planner]
yielding = 1.0

[arms.paper]
people = "paper"
"""
"""Four points that drive for some seconds each."""
RESULT = '{"measures": {"dynamic": {"expert": {"success": {"mean": %s, "low": 0, "high": 1}}}}}'


def write_sweep(folder: Path, text: str = EVALUATE) -> Path:
    """The file of a sweep."""
    path = folder / "sweep.toml"
    path.write_text(text)
    return path


def read_sweep(folder: Path, text: str = EVALUATE) -> Sweep:
    """A sweep."""
    return open_sweep(write_sweep(folder, text))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """A script that runs instead of `readygo` in points; it fails while `tmp_path/broken` is there."""
    script = tmp_path / "python"
    script.write_text(
        f"#!{sys.executable}\n"
        "import pathlib, sys\n"
        "arguments = sys.argv[3:]\n"
        f"broken = pathlib.Path({str(tmp_path / 'broken')!r})\n"
        "out = pathlib.Path(arguments[arguments.index('--out') + 1])\n"
        "out.mkdir(parents=True, exist_ok=True)\n"
        "(out / 'arguments').write_text(' '.join(arguments))\n"
        "if broken.exists() and 'paper' in arguments:\n"
        "    sys.exit('readygo: no such people.' if sys.stderr.write('one\\n') else 0)\n"
        "seed = int(arguments[arguments.index('--seed') + 1])\n"
        f"print('hello'); print({RESULT!r} % (0.5 + seed / 10))\n"
    )
    script.chmod(0o755)
    monkeypatch.setattr(point.sys, "executable", str(script))
    return script


def records_of(folder: Path) -> dict[str, Any]:
    """Hash, result and records of the episodes of each point."""
    points = json.loads((folder / "sweep.json").read_text())["points"]
    return {
        point["name"]: (point["sha256"], point["result"], (folder / point["name"] / "episodes.jsonl").read_text())
        for point in points
    }
