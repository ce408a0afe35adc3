"""Workers as Slurm jobs: what is asked of Slurm, and a run on a real one."""

import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.commands.generate import GenerateOptions, generate
from readygo.apps.fleet import slurm
from readygo.apps.fleet.slurm import SlurmWorkers, check_slurm
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.dataset import Dataset, validate
from readygo.common.errors import RunError
from readygo.common.scenes.embedded import ensure_embedded_scene
from tests.apps.fleet.slurm_cluster import slurm_cluster
from tests.apps.fleet.slurm_commands import fake_slurm


@pytest.fixture
def asked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setattr(slurm, "CHECK_S", 0.0)
    return fake_slurm(tmp_path, monkeypatch, "RUNNING\n")


def _workers(asked: Path, options: str = "") -> SlurmWorkers:
    return SlurmWorkers(connect="tcp/10.0.0.5:7447", run="run-7", logs=asked.parent / "logs", options=options)


def test_array_is_asked_for_with_the_users_options(asked: Path) -> None:
    _workers(asked, "--partition=short --time='2:00:00'").submit(3)
    words = asked.read_text().splitlines()
    assert words[0] == "sbatch"
    assert {"--array=0-2", "--requeue", "--partition=short", "--time=2:00:00"} <= set(words)
    script = words[words.index("--wrap") + 1]
    assert "worker all --connect tcp/10.0.0.5:7447 --run run-7" in script
    assert "$SLURM_ARRAY_TASK_ID-${SLURM_RESTART_COUNT:-0}" in script


def test_jobs_are_asked_for_with_all_that_a_worker_needs(asked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    given = []
    monkeypatch.setattr(
        slurm, "call_slurm", lambda *words, environment=None: given.append((words, environment)) or "17;cluster"
    )
    logs, certs = asked.parent / "logs", asked.parent / "certs"
    workers = SlurmWorkers(
        connect="tls/lab:7447", run="run-7", logs=logs, options="-p 'a b'", token="secret", certs=certs
    )
    workers.submit(5)
    ((words, environment),) = given
    root = Path(slurm.__file__).resolve().parents[2]
    assert words[:-1] == (
        "sbatch", "--parsable", "--array=0-4", "--requeue", "--open-mode=append", "--cpus-per-task=1",
        "--job-name=readygo-run-7", f"--output={logs}/slurm-%A_%a.log", f"--chdir={root}", "-p", "a b", "--wrap",
    )  # fmt: skip
    threads = "OMP_NUM_THREADS=1 OPENBLAS_NUM_THREADS=1 NUMBA_NUM_THREADS=1"
    command = f"{sys.executable} -m readygo worker all --connect tls/lab:7447 --run run-7 --certs {certs}"
    name = "slurm-$SLURM_ARRAY_JOB_ID-$SLURM_ARRAY_TASK_ID-${SLURM_RESTART_COUNT:-0}"
    assert words[-1] == f"exec env {threads} {command} --name {name}"
    assert environment["READYGO_TOKEN"] == "secret"


def test_slurm_is_asked_every_5_seconds_and_workers_are_submitted_ten_times_again(
    asked: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    now_s, calls = [100.0], []
    monkeypatch.setattr(slurm, "CHECK_S", 5.0)
    monkeypatch.setattr(slurm, "time", SimpleNamespace(monotonic=lambda: now_s[0]))
    monkeypatch.setattr(
        slurm,
        "call_slurm",
        lambda *words, environment=None: calls.append(words[0]) or {"sbatch": "17"}.get(words[0], ""),
    )
    workers = _workers(asked)
    workers.submit(3)
    now_s[0] += 4.9
    workers.check()
    assert calls == ["sbatch"]
    for number in range(1, 11):
        now_s[0] += 5.0
        workers.check()
        workers.check()
        assert calls == ["sbatch", *["squeue", "sbatch"] * number]
    now_s[0] += 5.0
    with pytest.raises(RunError, match=r"job 17 ended: they left no log\."):
        workers.check()


def test_workers_are_asked_for_anew_only_once_none_is_left(asked: Path) -> None:
    workers = _workers(asked)
    workers.submit(2)
    workers.check()
    assert asked.read_text().splitlines().count("sbatch") == 1
    (asked.parent / "queue").write_text("")
    workers.check()
    assert asked.read_text().splitlines().count("sbatch") == 2


def test_workers_that_end_again_and_again_end_the_run_with_their_last_words(asked: Path) -> None:
    workers = _workers(asked)
    workers.submit(1)
    (asked.parent / "queue").write_text("")
    (asked.parent / "logs" / "slurm-17_0.log").write_text("up\nreadygo: no such scene\n")
    for _ in range(slurm.RESTARTS_MAX):
        workers.check()
    with pytest.raises(RunError, match="job 17 ended: readygo: no such scene"):
        workers.check()


UNREACHABLE = "slurm_load_jobs error: Unable to contact slurm controller (connect failure)"


def _answers(asked: Path, command: str, answer: str) -> None:
    (asked.parent / "bin" / command).write_text(f"#!/bin/sh\necho {command} >> {asked}\n{answer}\n")


def _fails(asked: Path, command: str) -> None:
    _answers(asked, command, f"echo '{UNREACHABLE}' >&2\nexit 1")


def test_workers_of_a_slurm_that_does_not_answer_count_as_being_there(
    asked: Path, caplog: pytest.LogCaptureFixture
) -> None:
    with _workers(asked) as workers:
        workers.submit(2)
        _fails(asked, "squeue")
        for _ in range(3):
            workers.check()
        assert "scancel" not in asked.read_text().splitlines()
        assert [record.getMessage() for record in caplog.records] == [
            f"Slurm: {UNREACHABLE}; the run waits 10 min for Slurm, its workers continue."
        ]
        _answers(asked, "squeue", "echo")
        _fails(asked, "sbatch")
        workers.check()
        _answers(asked, "sbatch", "echo 18")
        workers.check()
        assert asked.read_text().splitlines().count("sbatch") == 3, "it is asked for workers again"
    assert asked.read_text().splitlines()[-3:] == ["scancel", "17", "18"]


def test_slurm_that_does_not_answer_for_minutes_ends_the_run(asked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    workers = _workers(asked)
    workers.submit(2)
    _fails(asked, "squeue")
    workers.check()
    _answers(asked, "squeue", "echo RUNNING")
    workers.check()
    _fails(asked, "squeue")
    now_s = time.monotonic()
    monkeypatch.setattr(time, "monotonic", lambda: now_s)
    workers.check()
    monkeypatch.setattr(time, "monotonic", lambda: now_s + slurm.UNANSWERED_MAX_S)
    workers.check()
    monkeypatch.setattr(time, "monotonic", lambda: now_s + slurm.UNANSWERED_MAX_S + 1.0)
    with pytest.raises(RunError, match=r"controller .*; so for 10 min: run the same command again"):
        workers.check()


def test_end_of_the_run_cancels_what_is_left(asked: Path) -> None:
    with _workers(asked) as workers:
        workers.submit(1)
    assert asked.read_text().splitlines()[-2:] == ["scancel", "17"]


def test_refusals_are_one_line(asked: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (asked.parent / "bin" / "sbatch").write_text("#!/bin/sh\necho 'sbatch: error: invalid partition' >&2\nexit 1\n")
    with pytest.raises(RunError, match=r"^Slurm: sbatch: error: invalid partition$"):
        _workers(asked).submit(1)
    with pytest.raises(RunError, match="cannot be split"):
        _workers(asked, "--comment='open")
    with pytest.raises(RunError, match="--listen with an address"):
        check_slurm(2, "")
    check_slurm(1, "tcp/10.0.0.5:7447")
    with pytest.raises(RunError, match="at least 1"):
        check_slurm(0, "tcp/10.0.0.5:7447")
    monkeypatch.setenv("PATH", "")
    with pytest.raises(RunError, match="needs sbatch"):
        _workers(asked)


@pytest.fixture(scope="module")
def cluster(tmp_path_factory: pytest.TempPathFactory) -> Iterator[None]:
    """Slurm with one node on this machine."""
    with slurm_cluster(tmp_path_factory.mktemp("slurm"), ["localhost"], cpus=8):
        yield


def _running() -> list[str]:
    found = subprocess.run(["squeue", "-h", "-t", "R", "-o", "%i"], capture_output=True, text=True, check=True)
    return found.stdout.split()


@pytest.mark.slow
def test_preempted_and_cancelled_workers_leave_the_same_data(cluster: None, tmp_path: Path) -> None:
    scene = ensure_embedded_scene(tmp_path / "embedded").path
    config = tmp_path / "short.toml"
    config.write_text("[episode]\ngoal_distance_max_m = 4.0\n")
    out, log = tmp_path / "jobs", tmp_path / "log"
    options = ["--episodes", "8", "--workers", "3", "--config", str(config), "--listen", free_endpoint(), "--json"]
    command = [sys.executable, "-m", "readygo", "generate", str(scene), "--out", str(out), "--on", "slurm", *options]
    with log.open("wb") as words, subprocess.Popen(command, stdout=words, stderr=words) as run:
        while len(_running()) < 3 and run.poll() is None:
            time.sleep(0.2)
        first, second, *_ = _running()
        subprocess.run(["scontrol", "requeue", first], check=True)
        subprocess.run(["scancel", second], check=True)
        assert run.wait(timeout=600) == 0, log.read_text()
    assert validate(out).ok
    for _ in range(100):
        if not _running():
            break
        time.sleep(0.1)
    assert _running() == []
    generate(GenerateOptions(scene=str(scene), out=tmp_path / "here", episodes=8, workers=0, config=config, json=True))
    assert Dataset([out]).content_hash == Dataset([tmp_path / "here"]).content_hash
