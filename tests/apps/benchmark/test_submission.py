import shutil
import zipfile
from pathlib import Path

import pytest

from readygo.apps.benchmark.drive import SuiteDrive, drive_suite
from readygo.apps.benchmark.submission import pack_results
from readygo.apps.benchmark.verify import Verification, verify_folder
from readygo.common.errors import RunError
from readygo.runs.benchmark.folder import MANIFEST_FILE, SUITE_FILE
from readygo.runs.benchmark.suite import OpenSuite


def test_packed_results_unpack_to_a_folder_that_verifies(driven: Path, suite: OpenSuite, tmp_path: Path):
    (driven / "notes.txt").write_text("not of the results")
    count = pack_results(driven, suite, tmp_path / "one.zip")
    pack_results(driven, suite, tmp_path / "two.zip")
    assert (tmp_path / "one.zip").read_bytes() == (tmp_path / "two.zip").read_bytes()
    with zipfile.ZipFile(tmp_path / "one.zip") as archive:
        names = archive.namelist()
        archive.extractall(tmp_path / "theirs")
    assert len(names) == count
    assert {MANIFEST_FILE, SUITE_FILE, "cells/people/flat/trajectories.jsonl"} <= set(names)
    assert "notes.txt" not in names
    theirs = Verification(suite=suite, folder=tmp_path / "theirs", checkpoints=tmp_path, share=0.2)
    assert verify_folder(theirs)[0] == []


def test_edited_results_are_not_packed(driven: Path, suite: OpenSuite, tmp_path: Path):
    copy = Path(shutil.copytree(driven, tmp_path / "copy"))
    path = copy / "cells" / "empty" / "flat" / "trajectories.jsonl"
    path.write_text(path.read_text().replace("0.0", "0.1", 1))
    with pytest.raises(RunError, match=r"is not as it was driven: cells/empty/flat/trajectories\.jsonl: was edited"):
        pack_results(copy, suite, tmp_path / "out.zip")
    assert not (tmp_path / "out.zip").exists()


def test_incomplete_results_are_not_packed(suite: OpenSuite, tmp_path: Path):
    few = SuiteDrive(suite=suite, drivers=("straight-line",), folder=tmp_path, checkpoints=tmp_path, episodes=1)
    drive_suite(few, report=lambda _: None)
    with pytest.raises(RunError, match="has 1 of 4 episodes per cell and driver: run the rest"):
        pack_results(tmp_path, suite, tmp_path / "out.zip")
