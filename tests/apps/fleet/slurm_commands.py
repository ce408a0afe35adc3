"""Commands of Slurm that only write down what they are asked."""

import os
from pathlib import Path

import pytest


def fake_slurm(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, queue: str = "") -> Path:
    """The file that the commands write to; `squeue` finds what `tmp_path/queue` says."""
    folder = tmp_path / "bin"
    folder.mkdir()
    for name, answer in (("sbatch", "echo '17;cluster'"), ("squeue", f"cat {tmp_path}/queue"), ("scancel", "true")):
        script = folder / name
        script.write_text(f'#!/bin/sh\nprintf "%s\\n" {name} "$@" >> {tmp_path}/asked\n{answer}\n')
        script.chmod(0o755)
    (tmp_path / "queue").write_text(queue)
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")
    return tmp_path / "asked"
