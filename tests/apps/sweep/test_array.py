import json
import subprocess
import sys
import time
from pathlib import Path

import pytest

from readygo.apps.commands.sweep import SweepOptions, sweep
from readygo.apps.sweep.array import index_ranges, submit_array
from readygo.apps.sweep.folder import SweepFolder
from readygo.apps.sweep.plan import PointNeeds
from readygo.common.errors import RunError
from tests.apps.fleet.slurm_cluster import kill_node, slurm_cluster
from tests.apps.fleet.slurm_commands import fake_slurm
from tests.apps.sweep.sweeps import LONGER, read_sweep, records_of, write_sweep


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return fake_slurm(tmp_path, monkeypatch)


def test_array_has_a_job_per_point(tmp_path: Path, asked: Path) -> None:
    plan, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    said = submit_array(
        folder, plan, plan.points, workers=3, needs=PointNeeds(cpus=4, gpus=2), options="-p 'a b' --time=2:00:00"
    )
    assert said == "Slurm job 17 has 8 points."
    words = asked.read_text().splitlines()
    words = words[words.index("sbatch") :]
    assert words == [
        "sbatch", "--parsable", "--array=0-7%3", "--requeue", "--open-mode=append", "--cpus-per-task=4",
        "--gpus-per-task=2",
        f"--job-name=readygo-sweep-{plan.sha256[:12]}", f"--output={folder.logs}/slurm-%A_%a.log",
        f"--chdir={Path.cwd()}", "-p", "a b", "--time=2:00:00", "--wrap",
        f"exec env OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 {sys.executable} -m readygo sweep "
        f"{folder.plan(plan)} --out {folder.path} --point $SLURM_ARRAY_TASK_ID",
    ]  # fmt: skip
    assert folder.logs.is_dir()


def test_only_what_is_left_is_asked_for(tmp_path: Path, asked: Path) -> None:
    plan, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    left = [plan.points[index] for index in (0, 1, 2, 5, 7)]
    submit_array(folder, plan, left, workers=0, needs=PointNeeds(), options="")
    assert "--array=0-2,5,7" in asked.read_text().splitlines()


def test_nothing_is_submitted_while_jobs_are_left(tmp_path: Path, asked: Path) -> None:
    (tmp_path / "queue").write_text("17\n17\n19\n")
    plan, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    said = submit_array(folder, plan, plan.points, workers=0, needs=PointNeeds(), options="")
    assert said == "Slurm still has jobs of this sweep, 17, 19: nothing is submitted."
    assert "sbatch" not in asked.read_text().splitlines()


def test_missing_slurm_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    plan, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    with pytest.raises(RunError, match="--on slurm needs sbatch"):
        submit_array(folder, plan, plan.points, workers=0, needs=PointNeeds(), options="")
    assert not folder.path.exists()


def _running_on(node: str) -> list[str]:
    asked = ["squeue", "-h", "-t", "R", "-w", node, "-o", "%i"]
    return subprocess.run(asked, capture_output=True, text=True, check=True).stdout.split()


@pytest.mark.slow
def test_sweep_on_two_nodes_of_slurm_of_which_one_is_killed_has_the_same_records(tmp_path: Path) -> None:
    path, out = write_sweep(tmp_path, LONGER), tmp_path / "out"
    with slurm_cluster(tmp_path / "slurm", ["first", "second"], cpus=1) as daemons:
        sweep(SweepOptions(sweep=path, out=out, on="slurm"))
        while not (killed := _running_on("second")):
            time.sleep(0.2)
        begun = read_sweep(tmp_path, LONGER).points[int(killed[0].partition("_")[2])]
        while not (out / ".sweep" / "points" / f"{begun.name}.json").exists():
            time.sleep(0.2)
        time.sleep(2.0)
        kill_node("second", daemons["second"])
        while subprocess.run(["squeue", "-h"], capture_output=True, text=True, check=True).stdout:
            time.sleep(0.5)
            # Slurm lets jobs of a lost node wait for two minutes.
            subprocess.run(["scontrol", "update", f"JobId={killed[0]}", "StartTime=now"], capture_output=True)
        sweep(SweepOptions(sweep=path, out=out, on="slurm"))
    sweep(SweepOptions(sweep=path, out=tmp_path / "here"))
    assert records_of(out) == records_of(tmp_path / "here")
    attempts = [point["attempts"] for point in json.loads((out / "sweep.json").read_text())["points"]]
    assert sum(attempts) > len(attempts) == 4


@pytest.mark.parametrize(
    ("indices", "words"), [([0], "0"), ([0, 1], "0-1"), ([3, 5, 6, 7, 9], "3,5-7,9"), ([0, 2, 4], "0,2,4")]
)
def test_numbers_are_ranges(indices: list[int], words: str) -> None:
    assert index_ranges(indices) == words
