from pathlib import Path

import pytest

from readygo.common.errors import RunError
from readygo.services.recorder.name_lock import NameLock


def test_name_is_one_processs_in_a_folder(tmp_path: Path) -> None:
    first, other = NameLock(tmp_path, "r0"), NameLock(tmp_path, "r1")
    assert sorted(path.name for path in tmp_path.iterdir()) == [".recorder-r0.lock", ".recorder-r1.lock"]
    first.release()
    first.release()
    NameLock(tmp_path, "r0").release()
    other.release()
    assert list(tmp_path.iterdir()) == []


def test_second_recorder_of_a_name_is_refused_unless_the_first_one_leaves(make_recorder, tmp_path, monkeypatch) -> None:
    monkeypatch.setattr("readygo.services.recorder.name_lock.LEAVING_S", 0.2)
    recorder = make_recorder()
    with pytest.raises(RunError, match=r"r0 is recording into .* already"):
        make_recorder()
    make_recorder("r1").close()
    recorder.close()
    make_recorder().close()
