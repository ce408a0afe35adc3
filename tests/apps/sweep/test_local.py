import sys
from pathlib import Path

import pytest

from readygo.apps.sweep import local
from readygo.apps.sweep.folder import SweepFolder
from readygo.apps.sweep.local import run_here
from tests.apps.sweep.sweeps import read_sweep


def _commands(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    monkeypatch.setattr(local, "point_command", lambda plan, out, index: [sys.executable, "-c", code, index])
    monkeypatch.setattr(local, "CHECK_S", 0.01)


def test_points_run_a_few_at_a_time_in_their_order(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep, folder, ended = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out"), list[str]()
    code = f"import sys, time; open({str(tmp_path / 'times')!r}, 'a').write(sys.argv[1] + ' '); time.sleep(0.3)"
    _commands(monkeypatch, code)
    run_here(folder, sweep, sweep.points[1:5], workers=1, ended=lambda point: ended.append(point.name))
    assert ended == [point.name for point in sweep.points[1:5]]
    assert (tmp_path / "times").read_text() == "1 2 3 4 "


def test_processes_end_with_the_sweep(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    sweep, folder, ended = read_sweep(tmp_path), SweepFolder(path=tmp_path / "out"), list[object]()
    _commands(monkeypatch, "import sys, time; sys.argv[1] == '0' or time.sleep(60)")
    real = local.end_child
    monkeypatch.setattr(local, "end_child", lambda child: (real(child), ended.append(child.returncode)))

    def stop(point: object) -> None:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run_here(folder, sweep, sweep.points, workers=3, ended=stop)
    assert ended == [-15, -15]
