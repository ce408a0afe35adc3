import re
import sys
from pathlib import Path

import pytest

from readygo.__main__ import main
from readygo.apps.benchmark.drive import SuiteDrive
from tests.common.dataset.episodes import write_shard
from tests.runs.benchmark.suites import small_suite


@pytest.fixture
def command(monkeypatch: pytest.MonkeyPatch, capsys):
    """Runs a command of `readygo benchmark`; returns its exit code and what it printed."""

    def run(*arguments: object) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["readygo", "benchmark", *map(str, arguments)])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        said = capsys.readouterr()
        return code, said.out, said.err

    return run


def test_suite_is_driven_verified_packed_and_made_a_table(command, tmp_path: Path):
    small_suite(tmp_path)
    suite, out = tmp_path / "small.toml", tmp_path / "out"
    code, said, _ = command("run", suite, "straight-line", "--out", out, "--episodes", 1)
    assert code == 0
    assert "Incomplete: 1 of 4 episodes" in said
    assert command("run", suite, "straight-line", "--out", out)[0] == 0
    code, said, _ = command("verify", out, "--suite", suite)
    assert (code, said.split(": ")[1]) == (0, "2 records driven again are the same.\n")
    assert command("submit", out, "--suite", suite, "--out", tmp_path / "mine.zip")[0] == 0
    assert (tmp_path / "mine.zip").exists()
    assert command("table", out, "--suite", suite, "--out", tmp_path / "page")[0] == 0
    assert "straight-line" in (tmp_path / "page" / "leaderboard.md").read_text()
    assert "</html>" in (tmp_path / "page" / "leaderboard.html").read_text()
    records = out / "cells" / "people" / "flat" / "episodes.jsonl"
    records.write_text(records.read_text().replace('"seed": 3', '"seed": 3 '))
    code, said, error = command("verify", out, "--suite", suite)
    assert (code, said) == (2, "cells/people/flat/episodes.jsonl: was edited\n")
    assert f"readygo: {out} does not verify: 1 mismatches" in error
    code, _, error = command("verify", out)
    assert (code, "is of the suite 'small/1', which does not come with readygo" in error) == (2, True)


@pytest.mark.parametrize("value", ['"abc"', "null", "[]", "-1.0"])
def test_damaged_record_is_one_line_in_every_command(command, tmp_path: Path, value: str):
    small_suite(tmp_path)
    suite, out = tmp_path / "small.toml", tmp_path / "out"
    assert command("run", suite, "straight-line", "--out", out, "--episodes", 1)[0] == 0
    records = out / "cells" / "people" / "flat" / "episodes.jsonl"
    records.write_text(re.sub(r'"duration_s": [\d.]+', f'"duration_s": {value}', records.read_text()))
    # Only complete results are packed.
    manifest = out / "benchmark.json"
    manifest.write_text(manifest.read_text().replace('"complete": false', '"complete": true'))
    for arguments in (("verify", out), ("table", out, "--out", "page"), ("submit", out, "--out", "mine.zip")):
        code, _, error = command(*arguments, "--suite", suite)
        assert code == 2
        (line,) = error.splitlines()
        assert line.startswith(f"readygo: {records} holds no record in line 1: duration_s must be a finite number")


def test_weights_are_said_where_to_get_and_hashed_without_a_pinned_hash(command, tmp_path: Path):
    pytest.importorskip("torch", reason="torch (extra train) is not installed")
    code, said, _ = command("weights", "--checkpoints", tmp_path)
    assert code == 2
    assert said.startswith("The authors offer gnm_large.pth, vint.pth, nomad.pth at https://drive.google.com/drive/")
    assert "pins no hashes of them" in said


def test_results_are_not_written_into_recorded_data_or_a_file(command, monkeypatch, tmp_path: Path):
    monkeypatch.chdir(tmp_path)
    write_shard(tmp_path / "data", [0])
    (tmp_path / "file").touch()
    before = sorted(tmp_path.rglob("*"))
    for out, words in (("data", "holds recorded data"), ("file", "is a file")):
        said = command("run", "pedestrian-nav/1", "expert", "--out", out)
        assert said == (2, "", f"readygo: --out {out} {words}; choose a new folder.\n")
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("driven", [True, False])
def test_interrupted_run_says_what_is_kept(command, monkeypatch, tmp_path: Path, driven):
    def interrupt(drive: SuiteDrive, **_: object) -> None:
        drive.folder.mkdir()
        if driven:
            (drive.folder / "cells").mkdir()
        raise KeyboardInterrupt

    monkeypatch.setattr("readygo.apps.commands.benchmark.drive_suite", interrupt)
    small_suite(tmp_path)
    out = tmp_path / "out"
    code, _, error = command("run", tmp_path / "small.toml", "straight-line", "--out", out)
    kept = f"the episodes that ended are kept in {out}; the same command resumes."
    assert code == 130
    assert error.splitlines()[-1] == f"readygo: stopped; {kept if driven else 'nothing is saved yet.'}"
    assert out.exists() == driven


@pytest.mark.parametrize(
    ("arguments", "said"),
    [
        (("run", "walks/1", "expert", "--out", "out"), "There is no suite 'walks/1'"),
        (("run", "pedestrian-nav/1", "--out", "out"), "Name a driver"),
        (("run", "pedestrian-nav/1", "nobody", "--out", "out"), "There is no method 'nobody'"),
        (("verify", "nowhere"), "nowhere holds no finished benchmark"),
        (("submit", "nowhere", "--out", "out.zip"), "nowhere holds no finished benchmark"),
        (("table", "nowhere", "--out", "page"), "nowhere holds no finished benchmark"),
        (("weights", "--checkpoints", "nowhere"), "gnm, vint, nomad cannot drive with what is in nowhere"),
    ],
)
def test_mistakes_are_one_line(command, monkeypatch, tmp_path: Path, arguments, said):
    monkeypatch.chdir(tmp_path)
    code, _, error = command(*arguments)
    assert code == 2
    # Progress may stand before it.
    assert said in error.splitlines()[-1]
    assert error.splitlines()[-1].startswith("readygo: ")
