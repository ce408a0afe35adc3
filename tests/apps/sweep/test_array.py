import sys
from pathlib import Path

import pytest

from readygo.apps.sweep.array import index_ranges, submit_array
from readygo.apps.sweep.folder import SweepFolder
from readygo.apps.sweep.plan import PointNeeds
from readygo.common.errors import RunError
from tests.apps.fleet.slurm_commands import fake_slurm
from tests.apps.sweep.sweeps import read_sweep


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    return fake_slurm(tmp_path, monkeypatch)


def test_array_has_a_job_per_point(tmp_path: Path, asked: Path) -> None:
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    said = submit_array(
        folder, sweep, sweep.points, workers=3, needs=PointNeeds(cpus=4, gpus=2), options="-p 'a b' --time=2:00:00"
    )
    assert said == "Slurm job 17 has 8 points."
    words = asked.read_text().splitlines()
    words = words[words.index("sbatch") :]
    assert words == [
        "sbatch", "--parsable", "--array=0-7%3", "--requeue", "--open-mode=append", "--cpus-per-task=4",
        "--gpus-per-task=2",
        f"--job-name=readygo-sweep-{sweep.sha256[:12]}", f"--output={folder.logs}/slurm-%A_%a.log",
        f"--chdir={Path.cwd()}", "-p", "a b", "--time=2:00:00", "--wrap",
        f"exec env OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1 {sys.executable} -m readygo sweep "
        f"{folder.plan(sweep)} --out {folder.path} --point $SLURM_ARRAY_TASK_ID",
    ]  # fmt: skip
    assert folder.logs.is_dir()


def test_only_what_is_left_is_asked_for(tmp_path: Path, asked: Path) -> None:
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    left = [sweep.points[index] for index in (0, 1, 2, 5, 7)]
    submit_array(folder, sweep, left, workers=0, needs=PointNeeds(), options="")
    assert "--array=0-2,5,7" in asked.read_text().splitlines()


def test_nothing_is_submitted_while_jobs_are_left(tmp_path: Path, asked: Path) -> None:
    (tmp_path / "queue").write_text("17\n17\n19\n")
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    said = submit_array(folder, sweep, sweep.points, workers=0, needs=PointNeeds(), options="")
    assert said == "Slurm still has jobs of this sweep, 17, 19: nothing is submitted."
    assert "sbatch" not in asked.read_text().splitlines()


def test_missing_slurm_is_said(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    sweep, folder = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out")
    with pytest.raises(RunError, match="--on slurm needs sbatch"):
        submit_array(folder, sweep, sweep.points, workers=0, needs=PointNeeds(), options="")
    assert not folder.path.exists()


@pytest.mark.parametrize(
    ("indices", "words"), [([0], "0"), ([0, 1], "0-1"), ([3, 5, 6, 7, 9], "3,5-7,9"), ([0, 2, 4], "0,2,4")]
)
def test_numbers_are_ranges(indices: list[int], words: str) -> None:
    assert index_ranges(indices) == words
