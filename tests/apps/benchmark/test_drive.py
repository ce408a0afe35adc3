import shutil
from pathlib import Path

import pytest

from readygo.apps.benchmark.drive import SuiteDrive, drive_suite
from readygo.common.errors import PolicyError, RunError
from readygo.runs.benchmark.folder import RECORD_FILES, cell_folder, read_cells, read_manifest, write_manifest
from readygo.runs.benchmark.suite import OpenSuite
from tests.runs.benchmark.suites import small_suite

DRIVERS = ("straight-line", "expert-oracle")


def drive_of(suite: OpenSuite, folder: Path, *drivers: str, **changes) -> SuiteDrive:
    return SuiteDrive(suite=suite, drivers=drivers, folder=folder, checkpoints=folder, **changes)


def test_every_driver_drives_the_same_episodes_of_every_cell(driven: Path, suite: OpenSuite):
    cells = read_cells(driven, suite, DRIVERS)
    for records in cells.values():
        keys = {name: {r.episode for r in records if r.method == name} for name in DRIVERS}
        assert len(keys["straight-line"]) == 4
        assert keys["straight-line"] == keys["expert-oracle"]
    assert all(record.human_distance_min_m == float("inf") for record in cells["empty"])
    assert all(record.human_distance_min_m < 20.0 for record in cells["people"])


def test_manifest_says_how_records_came(driven: Path, suite: OpenSuite):
    manifest = read_manifest(driven)
    assert manifest.complete
    assert set(manifest.made_by) == {"readygo", "commit", "numeric_class"}
    assert manifest.drivers["expert-oracle"].inputs.map
    assert manifest.scores["empty"]["expert-oracle"]["success"]["mean"] == 1.0
    assert {path.name for path in cell_folder(driven, "empty", "flat").iterdir()} == set(RECORD_FILES)


def test_run_resumes_to_the_same_bytes_and_is_incomplete_until_then(driven: Path, suite: OpenSuite, tmp_path: Path):
    reports = []
    few = drive_suite(drive_of(suite, tmp_path, "straight-line", episodes=2), report=reports.append)
    assert (few.episodes, few.complete, len(reports)) == (2, False, 4)
    whole = drive_suite(drive_of(suite, tmp_path, "straight-line", "expert-oracle"), report=lambda _: None)
    assert whole.complete
    assert whole.scores == read_manifest(driven).scores


def test_workers_drive_to_the_same_records(driven: Path, suite: OpenSuite, tmp_path: Path):
    drive = drive_of(suite, tmp_path, "straight-line", episodes=2, workers=1)
    drive_suite(drive, report=lambda _: None)
    for cell, records in read_cells(tmp_path, suite, DRIVERS).items():
        theirs = {record.key: record for record in read_cells(driven, suite, DRIVERS)[cell]}
        assert len(records) == 2
        assert all(theirs[record.key] == record for record in records)


def test_folder_of_another_suite_is_refused_before_driving(driven: Path, tmp_path: Path):
    other = small_suite(tmp_path, **{"seed = 3": "seed = 4"})
    with pytest.raises(RunError, match="is of the suite small/1 with the hash"):
        drive_suite(drive_of(other, driven, "expert"), report=lambda _: None)


@pytest.mark.parametrize(
    ("name", "what"), [("readygo", "version of readygo 0.0.9"), ("numeric_class", "numeric class 0.0.9")]
)
def test_records_of_another_version_or_machine_are_not_mixed(
    driven: Path, suite: OpenSuite, tmp_path: Path, name: str, what: str
):
    folder = shutil.copytree(driven, tmp_path / "out")
    manifest = read_manifest(folder)
    write_manifest(folder, suite, manifest.drivers, {**manifest.made_by, name: "0.0.9"})
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(RunError, match=rf"has records of the {what}, this is .*Give another --out"):
        drive_suite(drive_of(suite, folder, "social-force"), report=lambda _: None)
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


def test_commits_that_made_records_are_listed(driven: Path, suite: OpenSuite, tmp_path: Path):
    folder = shutil.copytree(driven, tmp_path / "out")
    made_by = read_manifest(folder).made_by
    write_manifest(folder, suite, read_manifest(folder).drivers, {**made_by, "commit": "abc"})
    drive_suite(drive_of(suite, folder, "straight-line"), report=lambda _: None)
    wanted = ", ".join(filter(None, dict.fromkeys(["abc", made_by["commit"]])))
    assert read_manifest(folder).made_by == {**made_by, "commit": wanted}


@pytest.mark.parametrize(
    ("driver", "error", "said"),
    [
        ("nobody", RunError, "There is no method 'nobody'"),
        ("policy", PolicyError, "name it"),
        ("gnm", PolicyError, "gnm needs its weights"),
    ],
)
def test_unknown_and_missing_drivers_are_refused(suite: OpenSuite, tmp_path: Path, driver, error, said):
    with pytest.raises(error, match=said):
        drive_suite(drive_of(suite, tmp_path / "out", driver), report=lambda _: None)
    assert not (tmp_path / "out").exists()


def test_numbers_that_make_no_run_are_refused(suite: OpenSuite, tmp_path: Path):
    with pytest.raises(RunError, match="Name a driver"):
        drive_of(suite, tmp_path)
    with pytest.raises(RunError, match=r"--episodes must be 1\.\.4 for this suite, got 5"):
        drive_of(suite, tmp_path, "expert", episodes=5)
    assert drive_of(suite, tmp_path, "expert", "rl").total == 4 * 2 * 2
