import dataclasses
import json
from pathlib import Path

import pytest

from readygo.common.episode import Conduct
from readygo.common.episode.metrics import EpisodeResult
from readygo.common.errors import RunError
from readygo.common.messages import EpisodeKey, Outcome, Split
from readygo.runs.benchmark.folder import (
    FIRST_FORMAT,
    MANIFEST_FILE,
    SUITE_FILE,
    BenchmarkedDriver,
    cell_folder,
    check_suite,
    check_unchanged,
    defects,
    join_origins,
    read_manifest,
    write_manifest,
)
from readygo.runs.benchmark.suite import OpenSuite
from readygo.services.evaluator import EpisodeRecord, Task, open_results
from tests.runs.benchmark.suites import small_suite


def record(task: Task, index: int, outcome: Outcome, driver: str = "mine") -> EpisodeRecord:
    conduct = Conduct(intrusion_s=0.0, near_misses=0, jerk_mps3=1.0, turn_acceleration_radps2=0.1, too_close_s=2.0)
    result = EpisodeResult(outcome=outcome, duration_s=4.0, path_length_m=3.0, shortest_m=3.0, conduct=conduct)
    key = EpisodeKey(seed=3, split=Split.TEST, index=index)
    return EpisodeRecord(episode=key, task=task, method=driver, result=result, human_distance_min_m=1.0)


@pytest.fixture
def suite(tmp_path: Path) -> OpenSuite:
    return small_suite(tmp_path / "suite")


@pytest.fixture
def folder(suite: OpenSuite, tmp_path: Path) -> Path:
    """Records of one driver that reaches every second goal among people."""
    folder = tmp_path / "results"
    for cell, scene in suite.places:
        task = Task(suite.suite.cells[cell].task)
        with open_results(cell_folder(folder, cell, scene), {"cell": cell}) as results:
            for index in range(4):
                reached = cell == "empty" or index % 2 == 0
                outcome = Outcome.SUCCESS if reached else Outcome.TIMEOUT
                results.keep(record(task, index, outcome), None)
    write_manifest(folder, suite, {"mine": BenchmarkedDriver(sha256="ab")}, {"readygo": "0.1.0"})
    return folder


def test_manifest_has_scores_with_intervals_and_hashes(folder: Path, suite: OpenSuite):
    manifest = read_manifest(folder)
    assert (manifest.suite, manifest.suite_sha256) == ("small/1", suite.sha256)
    assert (manifest.episodes, manifest.complete) == (4, True)
    people = manifest.scores["people"]["mine"]
    assert people["success"]["mean"] == 0.5
    assert people["compliance"]["mean"] == 0.5
    # 0.4 SR + 0.3 SPL + 0.3 PSC
    assert people["total"]["mean"] == pytest.approx(0.4 * 0.5 + 0.3 * 0.5 + 0.3 * 0.5)
    assert people["total"]["low"] < people["total"]["mean"] < people["total"]["high"]
    assert "cells/people/flat/episodes.jsonl" in manifest.files
    assert defects(folder, suite, manifest) == []


def test_edited_record_is_found_in_its_file_and_in_the_scores(folder: Path, suite: OpenSuite):
    path = folder / "cells" / "people" / "flat" / "episodes.jsonl"
    path.write_text(path.read_text().replace('"timeout"', '"success"', 1))
    assert defects(folder, suite, read_manifest(folder)) == [
        "cells/people/flat/episodes.jsonl: was edited",
        f"{MANIFEST_FILE}: the scores of people do not follow from its records",
    ]


def test_scores_that_do_not_follow_are_found(folder: Path, suite: OpenSuite):
    manifest = read_manifest(folder)
    better = json.loads(json.dumps(manifest.scores))
    better["people"]["mine"]["success"]["mean"] = 0.9
    lines = defects(folder, suite, dataclasses.replace(manifest, scores=better))
    assert lines == [f"{MANIFEST_FILE}: the scores of people do not follow from its records"]


def test_last_digits_of_scores_are_no_edit(folder: Path, suite: OpenSuite):
    manifest = read_manifest(folder)
    other = json.loads(json.dumps(manifest.scores))
    other["people"]["mine"]["success"]["low"] *= 1 + 1e-14
    assert defects(folder, suite, dataclasses.replace(manifest, scores=other)) == []


def test_changed_folder_is_refused_with_its_first_defect(folder: Path, suite: OpenSuite):
    manifest = read_manifest(folder)
    check_unchanged(folder, suite, manifest)
    with pytest.raises(
        RunError, match=r"is not as it was driven: benchmark\.json: the number of episodes does not follow"
    ):
        check_unchanged(folder, suite, dataclasses.replace(manifest, episodes=-3))
    (folder / SUITE_FILE).unlink()
    with pytest.raises(RunError, match=r"suite\.toml: is missing, and more\."):
        check_unchanged(folder, suite, dataclasses.replace(manifest, episodes=-3))


def test_manifest_of_the_first_format_does_not_state_what_some_drivers_learned_from(folder: Path):
    manifest = json.loads((folder / MANIFEST_FILE).read_text())
    inputs = {"map": True, "people": "", "images": ["rgb"], "trained_on": "its network", "seen": []}
    names = ("mine", "perceive-and-act", "gnm", "mine.py:Mine")
    manifest |= {"format": FIRST_FORMAT, "drivers": {name: {"sha256": "ab", "inputs": inputs} for name in names}}
    (folder / MANIFEST_FILE).write_text(json.dumps(manifest))
    drivers = read_manifest(folder).drivers
    assert (drivers["mine"].inputs.trained_on, drivers["mine"].inputs.seen) == ("its network", ())
    assert {(drivers[name].inputs.trained_on, drivers[name].inputs.seen) for name in names[1:]} == {(None, None)}
    assert drivers["perceive-and-act"].inputs.map


def test_what_records_of_several_folders_were_made_with_is_listed_once():
    origins = [{"readygo": "0.1.0", "commit": "a, b"}, {"readygo": "0.1.0", "commit": "b, c"}, {"commit": ""}]
    assert join_origins(origins) == {"readygo": "0.1.0", "commit": "a, b, c"}


def test_numbers_of_episodes_that_do_not_follow_are_found(folder: Path, suite: OpenSuite):
    manifest = read_manifest(folder)
    for changes in ({"complete": False}, {"episodes": 3}):
        lines = defects(folder, suite, dataclasses.replace(manifest, **changes))
        assert lines == [f"{MANIFEST_FILE}: the number of episodes does not follow from its records"]


def test_edited_or_missing_suite_is_found(folder: Path, suite: OpenSuite):
    (folder / SUITE_FILE).write_text("edited")
    assert defects(folder, suite, read_manifest(folder)) == [f"{SUITE_FILE}: was edited"]
    (folder / SUITE_FILE).unlink()
    assert defects(folder, suite, read_manifest(folder)) == [f"{SUITE_FILE}: is missing"]


def test_fewer_episodes_are_marked_as_incomplete(suite: OpenSuite, tmp_path: Path):
    for cell, scene in suite.places:
        with open_results(cell_folder(tmp_path / "few", cell, scene), {}) as results:
            results.keep(record(Task(suite.suite.cells[cell].task), 0, Outcome.SUCCESS), None)
    manifest = write_manifest(tmp_path / "few", suite, {"mine": BenchmarkedDriver()}, {})
    assert (manifest.episodes, manifest.complete) == (1, False)


def test_further_driver_joins_those_that_are_there(folder: Path, suite: OpenSuite):
    for cell, scene in suite.places:
        with open_results(cell_folder(folder, cell, scene), {"cell": cell}) as results:
            for index in range(4):
                kept = record(Task(suite.suite.cells[cell].task), index, Outcome.SUCCESS, "other")
                results.keep(kept, None)
    manifest = write_manifest(folder, suite, {"other": BenchmarkedDriver()}, {})
    assert {name: driver.sha256 for name, driver in manifest.drivers.items()} == {"mine": "ab", "other": ""}
    assert manifest.complete


def test_driver_that_was_interrupted_is_left_out(folder: Path, suite: OpenSuite):
    before = read_manifest(folder)
    with open_results(cell_folder(folder, "empty", "flat"), {"cell": "empty"}) as results:
        results.keep(record(Task.STATIC, 0, Outcome.SUCCESS, "other"), None)
    after = write_manifest(folder, suite, {}, {})
    assert (after.drivers, after.scores, after.complete) == (before.drivers, before.scores, True)
    assert defects(folder, suite, after) == []


def test_folder_of_another_suite_is_refused(folder: Path, tmp_path: Path):
    other = small_suite(tmp_path / "other", **{"seed = 3": "seed = 4"})
    with pytest.raises(RunError, match=r"is of the suite small/1 with the hash \w{12}\.\.\., not of small/1 with"):
        check_suite(read_manifest(folder), other, folder)


def test_folder_without_drivers_is_refused(folder: Path):
    manifest = json.loads((folder / MANIFEST_FILE).read_text())
    (folder / MANIFEST_FILE).write_text(json.dumps(manifest | {"drivers": {}}))
    with pytest.raises(RunError, match="names no driver: let `readygo benchmark run` end into"):
        read_manifest(folder)


@pytest.mark.parametrize(
    ("text", "said"),
    [(None, "holds no finished benchmark"), ("{", "cannot be read"), ('{"format": "x"}', "cannot be read")],
)
def test_folder_without_a_sound_manifest_is_one_line(tmp_path: Path, text: str | None, said: str):
    if text is not None:
        (tmp_path / MANIFEST_FILE).write_text(text)
    with pytest.raises(RunError, match=said) as caught:
        read_manifest(tmp_path)
    assert "\n" not in str(caught.value)
