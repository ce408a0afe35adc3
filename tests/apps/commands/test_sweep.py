import json
import os
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from readygo.__main__ import main
from readygo.apps.commands import sweep as command
from readygo.apps.options import SHORT_MAX, describe_options
from readygo.apps.sweep.folder import PointRecord, SweepFolder
from tests.apps.sweep.sweeps import EVALUATE, records_of, write_sweep

ONE_ARM = (
    EVALUATE.partition("[arms.paper]")[0].replace('"embedded", "embedded:1"', '"embedded"').replace(', "expert"', "")
)
SBATCH = """#!{python}
# Slurm that runs an array on this machine; each node dies once, when the point of its job has begun.
import os, pathlib, subprocess, sys, time
words = sys.argv[1:]
lost, records = pathlib.Path({lost!r}), pathlib.Path({records!r})
array = next(word for word in words if word.startswith("--array=")).partition("=")[2].partition("%")[0]
for part in array.split(","):
    low, _, high = part.partition("-")
    for index in range(int(low), int(high or low) + 1):
        environment = dict(os.environ, SLURM_ARRAY_TASK_ID=str(index))
        begun = len(list(records.rglob("*.json")))
        job = subprocess.Popen(["sh", "-c", words[-1]], env=environment, stdout=2)
        if not (lost / str(index)).exists():
            (lost / str(index)).touch()
            while job.poll() is None and len(list(records.rglob("*.json"))) == begun:
                time.sleep(0.02)
            job.kill()
        job.wait()
print("17")
"""


def _run(words: list[str], monkeypatch: pytest.MonkeyPatch) -> int:
    monkeypatch.setattr(sys, "argv", ["readygo", "sweep", *words])
    try:
        main()
    except SystemExit as end:
        return int(end.code or 0)
    return 0


def _fake_slurm(folder: Path, out: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    programs, lost = folder / "bin", folder / "lost"
    programs.mkdir()
    lost.mkdir()
    sbatch = SBATCH.format(python=sys.executable, lost=str(lost), records=str(SweepFolder(path=out).points))
    for name, text in (("sbatch", sbatch), ("squeue", "#!/bin/sh\n")):
        (programs / name).write_text(text)
        (programs / name).chmod(0o755)
    monkeypatch.setenv("PATH", f"{programs}{os.pathsep}{os.environ['PATH']}")


def _attempts(folder: Path) -> list[int]:
    return [point["attempts"] for point in json.loads((folder / "sweep.json").read_text())["points"]]


@pytest.mark.slow
def test_killed_sweep_and_one_on_slurm_that_loses_nodes_have_the_same_records(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path, killed, array = write_sweep(tmp_path, ONE_ARM), tmp_path / "killed", tmp_path / "slurm"
    process = subprocess.Popen([sys.executable, "-m", "readygo", "sweep", str(path), "--out", str(killed)])
    while not (killed / ".sweep" / "points" / "calm" / "embedded" / "1.json").exists():
        time.sleep(0.05)
    process.kill()
    process.wait()
    assert _run([str(path), "--out", str(killed)], monkeypatch) == 0
    said = capsys.readouterr()
    assert "calm/embedded/0" not in said.err
    assert "| calm | embedded | dynamic | straight-line | 2 |" in said.out
    _fake_slurm(tmp_path, array, monkeypatch)
    for _ in range(2):
        assert _run([str(path), "--out", str(array), "--on", "slurm"], monkeypatch) == 0
    assert records_of(array) == records_of(killed)
    assert _attempts(array) == [2, 2]
    assert _attempts(killed) == [1, 2]


def _quick(monkeypatch: pytest.MonkeyPatch, ending: dict[int, dict[str, Any]]) -> None:
    """Points that take no time; those of `ending` end so."""

    def run_here(folder: SweepFolder, sweep: Any, points: Any, *, workers: int, ended: Any) -> None:
        for point in points:
            how = {"state": "done", "result": {"episodes": 2}, **ending.get(point.index, {})}
            sha256 = command.point_sha256(sweep, point)
            folder.out(point).mkdir(parents=True, exist_ok=True)
            folder.write(point, PointRecord(name=point.name, sha256=sha256, **how))
            ended(point)

    monkeypatch.setattr(command, "run_here", run_here)


def test_failed_points_are_a_line_each_and_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(write_sweep(tmp_path)), "--out", str(tmp_path / "out")]
    _quick(monkeypatch, {1: {"state": "failed", "reason": "no such people."}})
    assert _run(words, monkeypatch) == 2
    said = capsys.readouterr()
    assert "calm/embedded/0: done in 0 s" in said.err
    assert "calm/embedded/1: failed: no such people." in said.err
    assert "1 of 8 points are not done; the same command runs them again" in said.err
    assert "7 of 8 points are done" in said.out
    _quick(monkeypatch, {})
    assert _run([*words, "--json"], monkeypatch) == 0
    said = capsys.readouterr()
    assert said.err.splitlines() == ["calm/embedded/1: done in 0 s"]
    assert len(json.loads(said.out)["points"]) == 8


def test_sweep_grows_and_refuses_other_options(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    _quick(monkeypatch, {})
    words = [str(write_sweep(tmp_path)), "--out", str(tmp_path / "out")]
    assert _run(words, monkeypatch) == 0
    write_sweep(tmp_path, EVALUATE.replace("[0, 1]", "[0, 1, 2]"))
    capsys.readouterr()
    assert _run(words, monkeypatch) == 0
    assert len(capsys.readouterr().err.splitlines()) == 4
    before = (tmp_path / "out" / "sweep.json").read_text()
    write_sweep(tmp_path, EVALUATE.replace("episodes = 3", "episodes = 4"))
    assert _run(words, monkeypatch) == 2
    assert "is of another sweep: its options, inputs or version" in capsys.readouterr().err
    assert (tmp_path / "out" / "sweep.json").read_text() == before


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["--on", "slurm"], "--on slurm needs sbatch"),
        (["--on", "ray"], "--on ray needs ray; run:"),
        (["--slurm", "-p x"], "--slurm has no effect without --on slurm"),
        (["--ray-address", "x:1"], "--ray-address has no effect without --on ray"),
        (["--manifest", "x"], "--manifest has no effect without --on kubernetes"),
        (["--workers", "-1"], "--workers must be at least 0"),
        (["--cpus", "0"], "--cpus must be at least 1, got 0"),
        (["--gpus", "-1"], "--gpus must be at least 0"),
        (["--on", "slurm", "--point", "1"], "--point runs here"),
        (["--point", "8"], "--point must be 0..7"),
        (["--on", "moon"], "--on must be local, slurm, kubernetes or ray"),
    ],
)
def test_bad_options_are_one_line_and_write_nothing(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    words: list[str],
    said: str,
) -> None:
    def no_ray() -> None:
        raise command.RunError("--on ray needs ray; run: x")

    monkeypatch.setattr(command, "import_ray", no_ray)
    monkeypatch.setenv("PATH", str(tmp_path))
    assert _run([str(write_sweep(tmp_path)), "--out", str(tmp_path / "out"), *words], monkeypatch) == 2
    error = capsys.readouterr().err
    assert said in error
    assert len(error.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_bad_file_and_foreign_folder_are_one_line(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_sweep(tmp_path, EVALUATE.replace("episodes = 3", "episode = 3"))
    assert _run([str(path), "--out", str(tmp_path / "out")], monkeypatch) == 2
    assert "arm calm: unknown option '--episode'" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert _run([str(write_sweep(tmp_path)), "--out", str(tmp_path)], monkeypatch) == 2
    assert "holds files of something else" in capsys.readouterr().err


def test_manifest_is_printed_or_written_and_nothing_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    words = [str(write_sweep(tmp_path)), "--out", "sweeps/a", "--on", "kubernetes", "--image", "mine"]
    assert _run(words, monkeypatch) == 0
    printed = capsys.readouterr().out
    assert "image: mine" in printed
    assert _run([*words, "--manifest", str(tmp_path / "job.yaml")], monkeypatch) == 0
    assert (tmp_path / "job.yaml").read_text() == printed
    assert "8 points. Run them: kubectl apply -f" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("record", "code", "said"),
    [
        ({"state": "done"}, 0, ""),
        ({"state": "failed", "exit_code": 2, "reason": "no scene."}, 2, "readygo: no scene."),
        ({"state": "failed", "exit_code": 1, "reason": "bug"}, 1, "readygo: calm/embedded/0 failed: bug"),
    ],
)
def test_single_point_ends_as_a_scheduler_needs_it(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    record: dict[str, Any],
    code: int,
    said: str,
) -> None:
    def run_point(folder: SweepFolder, sweep: Any, index: int) -> PointRecord:
        return PointRecord(name=sweep.points[index].name, sha256="a", **record)

    monkeypatch.setattr(command, "run_point", run_point)
    words = [str(write_sweep(tmp_path)), "--out", str(tmp_path / "out"), "--point", "0"]
    assert _run(words, monkeypatch) == code
    assert capsys.readouterr().err.strip() == said
    assert (tmp_path / "out" / "sweep.json").exists()


def test_interrupted_sweep_says_that_it_resumes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def interrupt(*_: Any, **__: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command, "run_here", interrupt)
    assert _run([str(write_sweep(tmp_path)), "--out", str(tmp_path / "out")], monkeypatch) == 128 + signal.SIGINT
    assert "stopped; what ended is kept in" in capsys.readouterr().err


def test_short_help_has_few_options() -> None:
    assert len(describe_options(command.SweepOptions).own.options) <= SHORT_MAX
