import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.export import formats, job
from readygo.apps.export.job import ExportJob, export
from readygo.common.errors import ConfigError, DatasetError


@pytest.fixture
def npz(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ExportJob:
    """An export with an episode in each part."""
    small = dataclasses.replace(formats.FORMATS["npz"], part_bytes=1)
    monkeypatch.setattr(job, "FORMATS", {"npz": small})
    return ExportJob(data=(data,), to="npz", out=tmp_path / "out")


def files(out: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in (out / "episodes").iterdir()}


def test_stopped_export_goes_on_with_what_is_left(npz: ExportJob, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(done: int, total: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(npz, progress=stop)
    first = files(npz.out)
    heard: list[tuple[int, int]] = []
    said = export(npz, progress=lambda done, total: heard.append((done, total)))
    assert heard == [(1, 3), (2, 3), (3, 3)]
    assert (said["episodes"], said["rows"], said["resumed_files"]) == (3, 37, 1)
    assert first.items() <= files(npz.out).items()
    assert export(npz)["resumed_files"] == 3


def test_several_processes_write_what_one_does(data: Path, tmp_path: Path, npz: ExportJob) -> None:
    export(npz)
    beside = dataclasses.replace(npz, out=tmp_path / "beside")
    export(beside, workers=2)
    assert files(npz.out).keys() == files(beside.out).keys()
    for name in files(npz.out):
        with np.load(npz.out / "episodes" / name) as one, np.load(beside.out / "episodes" / name) as other:
            assert {key: one[key].tobytes() for key in one} == {key: other[key].tobytes() for key in other}


def test_folder_of_something_else_is_left_alone(npz: ExportJob) -> None:
    npz.out.mkdir()
    (npz.out / "thesis.txt").write_text("mine")
    with pytest.raises(DatasetError, match="holds files of something else"):
        export(npz)
    assert [path.name for path in npz.out.iterdir()] == ["thesis.txt"]


def test_folder_of_another_export_is_refused(npz: ExportJob) -> None:
    export(npz)
    with pytest.raises(DatasetError, match="another export: rate_hz differ"):
        export(dataclasses.replace(npz, rate_hz=10))


def test_workers_must_be_some(npz: ExportJob) -> None:
    with pytest.raises(ConfigError, match="at least 1, got 0"):
        export(npz, workers=0)
