import os
import signal
import sys
from pathlib import Path

import pytest

from readygo.benchmarks.fleet import site as module
from readygo.benchmarks.fleet.site import LAUNCHER, DataSite, run_to_end
from readygo.common.errors import RunError
from readygo.runs.folder import RunFolder
from tests.apps.fleet.toy_line import DRAW, FILM, in_process, make_folder

pytestmark = pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")


def _site(folder: Path, code: str) -> DataSite:
    site = DataSite([], RunFolder(folder), folder / "log")
    site._command = [sys.executable, "-c", code]
    return site


def test_command_is_started_again_until_it_has_done_all(tmp_path: Path) -> None:
    mark = tmp_path / "mark"
    site = _site(
        tmp_path,
        f"import pathlib, sys; mark = pathlib.Path({str(mark)!r}); found = mark.exists(); mark.touch(); "
        "found or sys.exit('one more time')",
    )
    site.start()
    run_to_end(site, patience_s=60.0)
    assert site.reruns == ["one more time"]
    assert site.left_behind() == []


def test_run_that_never_ends_is_told(tmp_path: Path) -> None:
    site = _site(tmp_path, "import sys; sys.exit('no scene')")
    site.start()
    with pytest.raises(RunError, match="The run does not end: no scene"):
        run_to_end(site, patience_s=60.0, runs_max=0)
    site.stop()


def test_launcher_that_is_told_to_end_is_no_failure(tmp_path: Path) -> None:
    site = _site(tmp_path, "import time; time.sleep(60)")
    site.start()
    assert set(site.processes()) == {LAUNCHER}
    assert site.processes()[LAUNCHER] in site.left_behind()
    site.end(signal.SIGTERM)
    assert not site.keep_up()
    assert site.reruns == []
    site.stop()
    assert site.left_behind() == []


def test_run_of_which_nothing_becomes_durable_is_ended_and_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "HUNG_S", 0.0)
    site = _site(tmp_path, "import time; time.sleep(60)")
    site.start()
    pid = site.processes()[LAUNCHER]
    site.keep_up()
    site.keep_up()
    assert site.hung == 1
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)
    site.stop()


def test_durable_episodes_are_counted_in_all_places(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    folder = make_folder(tmp_path / "data", (DRAW, FILM), wanted=3, recorders=("rec0", "rec1"))
    site = DataSite([], folder, tmp_path / "log")
    assert site.durable() == 0
    assert in_process(folder, (DRAW, FILM)).finished
    assert (site.durable(), site.durable()) == (3, 3)
    assert site.places() == [folder.path]
    assert not disk.exists()
