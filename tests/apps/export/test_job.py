import dataclasses
from pathlib import Path

import pytest

from readygo.apps.export import formats, job
from readygo.apps.export.job import ExportJob, export
from readygo.common.errors import ConfigError, DatasetError


@pytest.fixture
def tars(data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ExportJob:
    """An export with an episode in each part."""
    small = dataclasses.replace(formats.FORMATS["webdataset"], part_bytes=1)
    monkeypatch.setattr(job, "FORMATS", {"webdataset": small})
    return ExportJob(data=(data,), to="webdataset", out=tmp_path / "out")


def files(out: Path) -> dict[str, int]:
    return {path.name: path.stat().st_mtime_ns for path in out.glob("*.tar")}


def test_stopped_export_goes_on_with_what_is_left(tars: ExportJob, monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(done: int, total: int) -> None:
        if done == 1:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export(tars, progress=stop)
    first = files(tars.out)
    heard: list[tuple[int, int]] = []
    said = export(tars, progress=lambda done, total: heard.append((done, total)))
    assert heard == [(1, 3), (2, 3), (3, 3)]
    assert (said["episodes"], said["rows"], said["resumed_files"]) == (3, 37, 1)
    assert first.items() <= files(tars.out).items()
    assert export(tars)["resumed_files"] == 3


def test_several_processes_write_what_one_does(data: Path, tmp_path: Path, tars: ExportJob) -> None:
    export(tars)
    beside = dataclasses.replace(tars, out=tmp_path / "beside")
    export(beside, workers=2)
    assert files(tars.out).keys() == files(beside.out).keys()
    for name in files(tars.out):
        assert (tars.out / name).read_bytes() == (beside.out / name).read_bytes()


def test_folder_of_something_else_is_left_alone(tars: ExportJob) -> None:
    tars.out.mkdir()
    (tars.out / "thesis.txt").write_text("mine")
    with pytest.raises(DatasetError, match="holds files of something else"):
        export(tars)
    assert [path.name for path in tars.out.iterdir()] == ["thesis.txt"]


def test_folder_of_another_export_is_refused(tars: ExportJob) -> None:
    export(tars)
    with pytest.raises(DatasetError, match="another export: rate_hz differ"):
        export(dataclasses.replace(tars, rate_hz=10))


def test_workers_must_be_some(tars: ExportJob) -> None:
    with pytest.raises(ConfigError, match="at least 1, got 0"):
        export(tars, workers=0)
