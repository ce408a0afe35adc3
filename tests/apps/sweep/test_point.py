import signal
from pathlib import Path

import pytest

from readygo.apps.sweep import point as points
from readygo.apps.sweep.folder import SweepFolder
from readygo.apps.sweep.point import point_command, run_point
from readygo.common.errors import RunError
from tests.apps.sweep.sweeps import quick, read_sweep

__all__ = ["quick"]


@pytest.fixture
def folder(tmp_path: Path) -> SweepFolder:
    return SweepFolder(path=tmp_path / "out")


def test_point_is_run_once_and_its_result_is_kept(tmp_path: Path, folder: SweepFolder, quick: Path) -> None:
    sweep = read_sweep(tmp_path)
    record = run_point(folder, sweep, 3)
    assert (record.name, record.state, record.attempts) == ("calm/embedded-1/1", "done", 1)
    assert record.result["measures"]["dynamic"]["expert"]["success"]["mean"] == 0.6
    said = (folder.path / "calm" / "embedded-1" / "1" / "arguments").read_text()
    assert said == " ".join(sweep.arguments(sweep.points[3], folder.out(sweep.points[3])))
    quick.unlink()
    assert run_point(folder, sweep, 3) == record


def test_failed_point_says_why_and_runs_again(tmp_path: Path, folder: SweepFolder, quick: Path) -> None:
    sweep = read_sweep(tmp_path)
    (tmp_path / "broken").touch()
    record = run_point(folder, sweep, 4)
    assert (record.state, record.reason, record.exit_code) == ("failed", "no such people.", 1)
    (tmp_path / "broken").unlink()
    record = run_point(folder, sweep, 4)
    assert (record.state, record.reason, record.attempts) == ("done", "", 2)


def test_killed_and_stopped_commands_are_told_apart(
    tmp_path: Path, folder: SweepFolder, quick: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = read_sweep(tmp_path)
    quick.write_text("#!/bin/sh\nkill -9 $$\n")
    record = run_point(folder, sweep, 0)
    assert (record.state, record.reason) == ("failed", f"it was ended by signal {int(signal.SIGKILL)}.")
    quick.write_text("#!/bin/sh\nexit 143\n")
    assert run_point(folder, sweep, 0).state == "interrupted"

    class Child:
        def wait(self) -> int:
            raise KeyboardInterrupt

    ended: list[object] = []
    monkeypatch.setattr(points, "start_child", lambda *_, **__: Child())
    monkeypatch.setattr(points, "end_child", ended.append)
    with pytest.raises(KeyboardInterrupt):
        run_point(folder, sweep, 0)
    assert len(ended) == 1
    record = folder.record(sweep.points[0])
    assert record is not None
    assert (record.state, record.attempts) == ("interrupted", 3)


def test_output_without_json_is_no_result(tmp_path: Path, folder: SweepFolder, quick: Path) -> None:
    quick.write_text("#!/bin/sh\necho fine\n")
    assert run_point(folder, read_sweep(tmp_path), 0).result is None
    quick.write_text("#!/bin/sh\n")
    assert run_point(folder, read_sweep(tmp_path), 1).result is None


def test_unknown_and_busy_points_are_refused(
    tmp_path: Path, folder: SweepFolder, quick: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    sweep = read_sweep(tmp_path)
    for index in (-1, 8):
        with pytest.raises(RunError, match=rf"--point must be 0\.\.7 in this sweep, got {index}"):
            run_point(folder, sweep, index)
    monkeypatch.setattr(points, "PATIENCE_S", 0.0)
    with folder.lock(sweep.points[0], patience_s=0.0), pytest.raises(RunError, match="Another process runs"):
        run_point(folder, sweep, 0)
    assert not folder.path.joinpath("calm").exists()


def test_command_of_a_point_names_plan_folder_and_number() -> None:
    command = point_command(Path("plan.toml"), Path("out"), "7")
    assert command[1:] == ["-m", "readygo", "sweep", "plan.toml", "--out", "out", "--point", "7"]
