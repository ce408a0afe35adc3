import os
from pathlib import Path

import pytest

from readygo.apps.sweep.folder import PointRecord, SweepFolder
from readygo.apps.sweep.plan import open_sweep
from readygo.common.errors import RunError
from readygo.common.locks import hold
from tests.apps.sweep.sweeps import read_sweep


def _record(**values: object) -> PointRecord:
    return PointRecord(**{"name": "calm/embedded/0", "sha256": "a", "state": "done", **values})  # type: ignore[arg-type]


def test_record_is_read_as_it_was_written(tmp_path: Path) -> None:
    folder, point = SweepFolder(path=tmp_path / "out"), read_sweep(tmp_path).points[0]
    assert folder.record(point) is None
    record = _record(result={"a": [1, 2.5]}, reason="x", wall_s=1.5)
    folder.write(point, record)
    assert folder.record(point) == record
    assert folder.log(point).name == "0.log"
    assert folder.output(point).parent == folder.state / "points" / "calm" / "embedded"


def test_damaged_record_is_one_line(tmp_path: Path) -> None:
    folder, point = SweepFolder(path=tmp_path), read_sweep(tmp_path).points[0]
    folder.write(point, _record())
    path = folder.log(point).with_suffix(".json")
    path.write_text("{")
    with pytest.raises(RunError, match=r"0\.json cannot be read"):
        folder.record(point)


def test_point_of_another_run_is_refused_once_it_has_written(tmp_path: Path) -> None:
    folder, point = SweepFolder(path=tmp_path), read_sweep(tmp_path).points[0]
    folder.write(point, _record())
    assert folder.record_of(point, "a") == _record()
    assert folder.record_of(point, "b") is None
    folder.out(point).mkdir(parents=True)
    with pytest.raises(RunError, match="of another sweep"):
        folder.record_of(point, "b")
    folder.write(point, _record(state="failed"))
    assert folder.record_of(point, "b") is None


def test_plan_is_a_copy_by_its_hash(tmp_path: Path) -> None:
    folder, sweep = SweepFolder(path=tmp_path / "out"), read_sweep(tmp_path)
    path = folder.keep_plan(sweep)
    assert path == folder.plan(sweep)
    assert path.name == f"{sweep.sha256[:16]}.toml"
    assert open_sweep(path) == sweep


def test_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    SweepFolder(path=tmp_path / "new").check_free()
    (tmp_path / "file").write_text("")
    with pytest.raises(RunError, match="files of something else"):
        SweepFolder(path=tmp_path).check_free()
    (tmp_path / ".sweep").mkdir()
    SweepFolder(path=tmp_path).check_free()


def test_only_one_process_holds_a_point(tmp_path: Path) -> None:
    folder, point = SweepFolder(path=tmp_path), read_sweep(tmp_path).points[0]
    assert not folder.runs(point)
    with folder.lock(point, patience_s=0.0) as held:
        assert held
        assert folder.runs(point)
        with folder.lock(point, patience_s=0.0) as again:
            assert not again
    assert not folder.runs(point)
    with folder.lock_all(patience_s=0.0) as held:
        assert held
        assert hold(folder.state / "lock") is None


@pytest.mark.skipif(os.geteuid() == 0, reason="root writes everywhere")
def test_read_only_folder_is_one_line(tmp_path: Path) -> None:
    tmp_path.chmod(0o500)
    with pytest.raises(RunError, match="cannot be written"), SweepFolder(path=tmp_path).lock_all(patience_s=0.0):
        pass
