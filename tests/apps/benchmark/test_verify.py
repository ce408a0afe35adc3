import json
import shutil
from pathlib import Path

import pytest

from readygo.apps.benchmark.drive import SuiteDrive, drive_suite
from readygo.apps.benchmark.verify import Verification, verify_folder
from readygo.common.errors import RunError
from readygo.runs.benchmark.folder import FIRST_FORMAT, MANIFEST_FILE, read_manifest, write_manifest
from readygo.runs.benchmark.suite import OpenSuite
from tests.common.policy.artifacts import write_policy

PEOPLE = Path("cells", "people", "flat")
CLASS = """
class Mine:
    trained_on = "ten films"

    def __init__(self, robot): ...

    def start(self): ...

    def act(self, memory, observation):
        return 0.5, 0.0
"""


@pytest.fixture
def copy(driven: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(driven, tmp_path / "copy"))


def verify(suite: OpenSuite, folder: Path, **changes) -> tuple[list[str], int]:
    return verify_folder(Verification(suite=suite, folder=folder, checkpoints=folder, **changes))


def edit(folder: Path, name: str, change) -> None:
    """Change the first line of a file of the people's cell, as values."""
    path = folder / PEOPLE / name
    first, *others = path.read_text().splitlines(keepends=True)
    kept = json.loads(first)
    change(kept)
    path.write_text(json.dumps(kept) + "\n" + "".join(others))


def hashed_again(folder: Path, suite: OpenSuite) -> None:
    """Write the manifest anew, as somebody would who hides an edited record."""
    manifest = read_manifest(folder)
    write_manifest(folder, suite, manifest.drivers, manifest.made_by)


def test_results_verify_with_a_record_of_every_cell_driven_again(driven: Path, suite: OpenSuite):
    assert verify(suite, driven) == ([], 2)
    assert verify(suite, driven, share=0.0) == ([], 0)
    shown: list[tuple[int, int]] = []
    verification = Verification(suite=suite, folder=driven, checkpoints=driven, share=1.0)
    assert verify_folder(verification, lambda done, total: shown.append((done, total))) == ([], 16)
    assert shown == [(k, 16) for k in range(1, 17)]


def test_edited_record_is_found_without_driving(copy: Path, suite: OpenSuite):
    edit(copy, "episodes.jsonl", lambda record: record.update(outcome="success"))
    lines, _ = verify(suite, copy, share=0.0)
    assert lines[0] == f"{(PEOPLE / 'episodes.jsonl').as_posix()}: was edited"


def test_edited_record_whose_hashes_were_made_anew_is_found_by_driving(copy: Path, suite: OpenSuite):
    edit(copy, "episodes.jsonl", lambda record: record.update(path_length_m=1.0))
    hashed_again(copy, suite)
    (line,), driven = verify(suite, copy, share=1.0)
    assert driven == 16
    assert "has path_length_m 1.0, driven again" in line


def test_edited_command_is_found_by_driving(copy: Path, suite: OpenSuite):
    edit(copy, "trajectories.jsonl", lambda kept: kept["actions"][0].__setitem__(0, 0.5))
    hashed_again(copy, suite)
    assert ["has other commands" in line for line in verify(suite, copy, share=1.0)[0]] == [True]


def test_left_out_episode_is_found(copy: Path, suite: OpenSuite):
    path = copy / PEOPLE / "episodes.jsonl"
    others = [line for line in path.read_text().splitlines(keepends=True) if '"index": 0' not in line]
    path.write_text("".join(others))
    # Whoever hides a failure says that all were to be driven.
    hashed_again(copy, suite)
    manifest = json.loads((copy / MANIFEST_FILE).read_text())
    (copy / MANIFEST_FILE).write_text(json.dumps(manifest | {"episodes": 4, "complete": True}))
    lines, _ = verify(suite, copy, share=0.0)
    assert lines == [
        "benchmark.json: the number of episodes does not follow from its records",
        *(f"people, flat: 1 episodes of {name} are missing" for name in manifest["drivers"]),
    ]


def test_record_of_no_episode_of_the_suite_is_found(copy: Path, suite: OpenSuite):
    edit(copy, "episodes.jsonl", lambda record: record.update(index=1000))
    hashed_again(copy, suite)
    assert verify(suite, copy, share=0.0)[0] == [
        "people, flat: 1 episodes of straight-line are missing",
        "people, flat: 1 records of straight-line are of no episode of the suite",
    ]


def test_driver_that_drove_more_than_the_others_verifies(suite: OpenSuite, tmp_path: Path):
    for driver, episodes in (("straight-line", 3), ("expert-oracle", 1)):
        few = SuiteDrive(suite=suite, drivers=(driver,), folder=tmp_path, checkpoints=tmp_path, episodes=episodes)
        drive_suite(few, report=lambda _: None)
    assert verify(suite, tmp_path, share=1.0) == ([], 8)


def test_wrong_inputs_of_a_driver_are_found(copy: Path, suite: OpenSuite):
    manifest = json.loads((copy / MANIFEST_FILE).read_text())
    manifest["drivers"]["expert-oracle"]["inputs"]["people"] = ""
    (copy / MANIFEST_FILE).write_text(json.dumps(manifest))
    found = "true, all, and where they mean to walk"
    assert verify(suite, copy)[0] == [f"benchmark.json: people of expert-oracle is '' there, found '{found}'"]


def test_first_format_verifies_although_it_does_not_state_what_a_class_learned_from(suite: OpenSuite, tmp_path: Path):
    (tmp_path / "mine.py").write_text(CLASS)
    name, folder = f"{tmp_path / 'mine.py'}:Mine", tmp_path / "out"
    drive_suite(SuiteDrive(suite=suite, drivers=(name,), folder=folder, checkpoints=folder), report=lambda _: None)
    manifest = json.loads((folder / MANIFEST_FILE).read_text())
    assert manifest["drivers"][name]["inputs"]["trained_on"] == "ten films"
    manifest["drivers"][name]["inputs"] |= {"trained_on": "", "seen": []}
    (folder / MANIFEST_FILE).write_text(json.dumps(manifest | {"format": FIRST_FORMAT}))
    assert verify(suite, folder)[0] == []
    (folder / MANIFEST_FILE).write_text(json.dumps(manifest))
    assert verify(suite, folder)[0] == [
        f"benchmark.json: trained_on of {name} is '' there, found 'ten films'",
        f"benchmark.json: seen of {name} is [] there, found None",
    ]


def test_other_settings_are_found(copy: Path, suite: OpenSuite):
    path = copy / PEOPLE / "settings.json"
    settings = json.loads(path.read_text())
    settings["config"]["episode"]["success_radius_m"] = 2.0
    path.write_text(json.dumps(settings))
    hashed_again(copy, suite)
    assert verify(suite, copy, share=0.0)[0] == ["people, flat: the settings are not those of the suite"]


def test_driver_with_other_files_is_refused(copy: Path, suite: OpenSuite):
    manifest = json.loads((copy / MANIFEST_FILE).read_text())
    manifest["drivers"]["mine"] = {"sha256": "ab", "inputs": {}}
    (copy / MANIFEST_FILE).write_text(json.dumps(manifest))
    with pytest.raises(RunError, match=r"The driver mine is not in .*copy \(SHA-256 ab\.\.\.\): get it from who drove"):
        verify(suite, copy)
    write_policy(copy / "mine")
    with pytest.raises(RunError, match="The driver mine is another one here"):
        verify(suite, copy)


def test_numbers_out_of_range_are_refused(driven: Path, suite: OpenSuite):
    for changes, said in (({"share": 1.5}, "--share must be"), ({"seed": -1}, "--seed must be")):
        with pytest.raises(RunError, match=said):
            verify(suite, driven, **changes)
