import json
import shutil
from pathlib import Path

import pytest

from readygo.apps.benchmark.drive import SuiteDrive, drive_suite
from readygo.apps.benchmark.leaderboard import (
    films_to_show,
    leaderboard_html,
    leaderboard_markdown,
    read_leaderboard,
)
from readygo.apps.report.page import MediaFigure
from readygo.common.errors import RunError
from readygo.runs.benchmark.folder import MANIFEST_FILE, BenchmarkedDriver, read_manifest, write_manifest
from readygo.runs.benchmark.inputs import DriverInputs
from readygo.runs.benchmark.suite import OpenSuite
from tests.runs.benchmark.suites import small_suite


def renamed(
    driven: Path,
    folder: Path,
    suite: OpenSuite,
    *names: str,
    hashes: tuple[str, str] = ("ab", "cd"),
    made_by: dict[str, str] | None = None,
) -> Path:
    """A folder with the records of the two drivers under other names, as of policies."""
    shutil.copytree(driven, folder)
    (folder / MANIFEST_FILE).unlink()
    for path in folder.rglob("*.jsonl"):
        text = path.read_text()
        for old, new in zip(("straight-line", "expert-oracle"), names, strict=True):
            text = text.replace(f'"{old}"', f'"{new}"')
        path.write_text(text)
    inputs = DriverInputs(images=("rgb",), trained_on="flat; 2 people")
    learned = {
        name: BenchmarkedDriver(sha256=sha256, inputs=inputs) for name, sha256 in zip(names, hashes, strict=True)
    }
    write_manifest(folder, suite, learned, made_by or {})
    return folder


def test_rows_of_several_folders_join_and_common_drivers_count_once(driven: Path, suite: OpenSuite, tmp_path: Path):
    theirs = renamed(driven, tmp_path / "theirs", suite, "straight-line", "mine")
    manifest = read_manifest(theirs)
    write_manifest(theirs, suite, {**manifest.drivers, "straight-line": BenchmarkedDriver()}, {})
    board = read_leaderboard([driven, theirs], suite)
    assert [row.name for row in board.rows] == ["expert-oracle", "mine", "straight-line"], "the best total first"
    assert board.reference == "straight-line"
    assert [len(row.cells["people"]) for row in board.rows] == [4, 4, 4]
    assert board.folders["mine"] == theirs
    assert [row.seeds for row in board.rows] == [0, 1, 0]


def test_policies_of_several_seeds_are_one_row_with_the_mean_of_both(driven: Path, suite: OpenSuite, tmp_path: Path):
    theirs = renamed(driven, tmp_path / "theirs", suite, "mine/0", "mine/1")
    board = read_leaderboard([driven, theirs], suite, "expert-oracle")
    (row,) = [row for row in board.rows if row.name == "mine"]
    assert row.seeds == 2
    scores = board.scores("people")
    one, other = scores["straight-line"]["success"], scores["expert-oracle"]["success"]
    assert scores["mine"]["success"].mean == pytest.approx((one.mean + other.mean) / 2)
    assert scores["mine"]["success"].count == 4
    assert {pair.method for pair in board.comparisons("people")} == {"straight-line", "mine/0", "mine/1"}


def test_equal_policies_of_a_row_count_once(driven: Path, suite: OpenSuite, tmp_path: Path):
    theirs = renamed(driven, tmp_path / "theirs", suite, "mine/0", "mine/1", hashes=("ab", "ab"))
    (row,) = read_leaderboard([theirs], suite).rows
    assert row.seeds == 1


def test_zero_shot_and_fine_tuned_network_are_two_rows(driven: Path, suite: OpenSuite, tmp_path: Path):
    theirs = renamed(driven, tmp_path / "theirs", suite, "gnm/zero-shot", "gnm/fine-tuned")
    assert {row.name: row.seeds for row in read_leaderboard([theirs], suite).rows} == {
        "gnm/zero-shot": 1,
        "gnm/fine-tuned": 1,
    }


def test_rows_name_the_versions_in_which_they_differ(driven: Path, suite: OpenSuite, tmp_path: Path):
    made_by = {"readygo": "9.0", "commit": "f" * 40, "numeric_class": read_manifest(driven).made_by["numeric_class"]}
    theirs = renamed(driven, tmp_path / "theirs", suite, "mine", "yours", made_by=made_by)
    markdown, html = (
        write(read_leaderboard([driven, theirs], suite)) for write in (leaderboard_markdown, leaderboard_html)
    )
    ours = read_manifest(driven).made_by
    assert "| Episodes per cell | readygo | Commit |" in markdown
    assert "Numeric class" not in markdown, "it is the same"
    assert "| 4 | 9.0 | ffffffffffff |" in markdown
    for page in (markdown, html):
        assert f"{ours['readygo']}, 9.0" in page
        assert ours["numeric_class"] in page
    assert "| Episodes per cell |\n" in leaderboard_markdown(read_leaderboard([driven], suite))


def test_what_a_driver_does_not_state_is_said(driven: Path, suite: OpenSuite, tmp_path: Path):
    theirs = renamed(driven, tmp_path / "theirs", suite, "a.py:A", "b.py:B")
    unstated = BenchmarkedDriver(sha256="ab", inputs=DriverInputs(images=("rgb",), trained_on=None, seen=None))
    write_manifest(theirs, suite, {"a.py:A": unstated}, {})
    assert "| A | no | no | rgb | not stated | not stated |  | 4 |" in leaderboard_markdown(
        read_leaderboard([theirs], suite)
    )


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda manifest: manifest.update(episodes=-3), "the number of episodes does not follow"),
        (lambda manifest: manifest["files"].popitem(), "is not in benchmark.json"),
        (lambda manifest: manifest["scores"]["people"]["straight-line"]["total"].update(mean=1.0), "do not follow"),
    ],
)
def test_changed_folder_is_refused(driven: Path, suite: OpenSuite, tmp_path: Path, change, said: str):
    copy = Path(shutil.copytree(driven, tmp_path / "copy"))
    manifest = json.loads((copy / MANIFEST_FILE).read_text())
    change(manifest)
    (copy / MANIFEST_FILE).write_text(json.dumps(manifest))
    with pytest.raises(RunError, match=f"copy is not as it was driven: .*{said}"):
        read_leaderboard([copy], suite)


def test_page_and_markdown_say_what_drivers_are_given_and_how_they_did(driven: Path, suite: OpenSuite):
    board = read_leaderboard([driven], suite)
    film = MediaFigure(video="films/x.webm", caption="The worst.")
    html, markdown = leaderboard_html(board, [film]), leaderboard_markdown(board)
    for words in ("expert-oracle", "true, all, and where they mean to walk", "PSC", suite.sha256[:12]):
        assert words in html
        assert words in markdown
    assert "films/x.webm" in html
    assert "within 1 m of the goal, without collision, in 8 s" in html, "as the suite has it"
    assert (
        "| Driver | Map | People | Images | Trained on | Scenes seen | Training seeds | Episodes per cell |" in markdown
    )
    assert "| none |  | 4 |" in markdown
    assert "| people | expert-oracle | +" in markdown, "beside the reference"
    assert "</html>" in html


def test_row_of_fewer_episodes_is_marked(suite: OpenSuite, tmp_path: Path):
    few = SuiteDrive(suite=suite, drivers=("straight-line",), folder=tmp_path, checkpoints=tmp_path, episodes=2)
    drive_suite(few, report=lambda _: None)
    assert "| 2, incomplete |" in leaderboard_markdown(read_leaderboard([tmp_path], suite))


def test_seed_of_fewer_episodes_marks_its_row(driven: Path, suite: OpenSuite, tmp_path: Path):
    theirs = renamed(driven, tmp_path / "theirs", suite, "mine/0", "mine/1")
    path = theirs / "cells" / "people" / "flat" / "episodes.jsonl"
    path.write_text(
        "".join(
            line
            for line in path.read_text().splitlines(keepends=True)
            if not ("mine/1" in line and '"index": 0' in line)
        )
    )
    write_manifest(theirs, suite, {}, {})
    board = read_leaderboard([theirs], suite)
    assert (board.rows[0].episodes, board.episodes) == (3, 3)


def test_folder_without_records_of_a_driver_is_refused(driven: Path, suite: OpenSuite, tmp_path: Path):
    copy = Path(shutil.copytree(driven, tmp_path / "copy"))
    (copy / "cells" / "people" / "flat" / "episodes.jsonl").write_bytes(b"")
    write_manifest(copy, suite, {}, {})
    with pytest.raises(RunError, match="copy has no records of expert-oracle in the cell people: let the run end"):
        read_leaderboard([copy], suite)


def test_median_and_worst_episode_of_each_row_are_filmed(driven: Path, suite: OpenSuite):
    board = read_leaderboard([driven], suite)
    chosen = films_to_show(board)
    assert [(row.name, word) for row, word, _ in chosen] == [
        *(("expert-oracle", "median"), ("expert-oracle", "worst")),
        *(("straight-line", "median"), ("straight-line", "worst")),
    ]
    assert all(record in row.cells["people"] for row, _, record in chosen)


def test_what_does_not_join_is_refused(driven: Path, suite: OpenSuite, tmp_path: Path):
    theirs = renamed(driven, tmp_path / "theirs", suite, "straight-line", "mine")
    with pytest.raises(RunError, match="has another driver straight-line than a folder before it"):
        read_leaderboard([driven, theirs], suite)
    with pytest.raises(RunError, match="There is no driver 'nobody' to compare with; there are straight-line"):
        read_leaderboard([driven], suite, "nobody")
    with pytest.raises(RunError, match="is of the suite small/1 with the hash"):
        read_leaderboard([driven], small_suite(tmp_path / "other", **{"seed = 3": "seed = 4"}))
