"""Coverage of datasets whose content is known."""

import json
import sys

import pytest

from readygo.__main__ import main
from readygo.apps.commands.coverage import CoverageOptions, coverage
from readygo.common.errors import DatasetError, SceneError
from readygo.common.maps import save_ros_map


def test_files_are_complete_and_the_same_each_time(data, tmp_path, capsys) -> None:
    for name in ("a", "b"):
        coverage(CoverageOptions(data=data, out=tmp_path / name))
    assert "coverage.html" in capsys.readouterr().out
    for file in ("coverage.html", "coverage.json", "visits.png", "sharpness.png"):
        assert (tmp_path / "a" / file).read_bytes() == (tmp_path / "b" / file).read_bytes()
    assert len(list((tmp_path / "a").iterdir())) == 4


def test_json_holds_what_the_page_shows(data, tmp_path, capsys) -> None:
    coverage(CoverageOptions(data=data, out=tmp_path / "out", json=True))
    numbers = json.loads(capsys.readouterr().out)
    assert numbers == json.loads((tmp_path / "out" / "coverage.json").read_text())
    assert numbers["encounters"]["crossing"] == {"episodes": 2, "people": 2, "failed": None}
    assert numbers["rejected"] is numbers["visited_share"] is None
    assert numbers["scene"] == "plaza"
    assert numbers["clarity"]["episodes_blurred"] == 0
    assert numbers["visited_m2"] == pytest.approx(0.19)


def test_page_says_when_the_map_is_not_at_hand_and_draws_it_when_it_is_named(data, room, tmp_path) -> None:
    coverage(CoverageOptions(data=data, out=tmp_path / "out"))
    assert "not available" in (tmp_path / "out" / "coverage.html").read_text()
    save_ros_map(room, tmp_path / "room.yaml")
    coverage(CoverageOptions(data=data, out=tmp_path / "out", scene=str(tmp_path / "room.yaml")))
    assert "not available" not in (tmp_path / "out" / "coverage.html").read_text()
    assert json.loads((tmp_path / "out" / "coverage.json").read_text())["visited_share"] > 0


def test_page_is_not_written_into_recorded_data_or_a_file(data, tmp_path, monkeypatch, capsys) -> None:
    before = sorted(data.rglob("*"))
    (tmp_path / "file").touch()
    for out, words in ((data, "holds recorded data"), (tmp_path / "file", "is a file")):
        monkeypatch.setattr(sys, "argv", ["readygo", "coverage", str(data), "--out", str(out)])
        with pytest.raises(SystemExit) as stop:
            main()
        assert stop.value.code == 2
        assert capsys.readouterr().err == f"readygo: --out {out} {words}; choose a new folder.\n"
    assert sorted(data.rglob("*")) == before


def test_mistakes_leave_nothing_behind(data, tmp_path) -> None:
    with pytest.raises(DatasetError, match="does not exist"):
        coverage(CoverageOptions(data=tmp_path / "nowhere", out=tmp_path / "out"))
    with pytest.raises(SceneError, match="cannot be read"):
        coverage(CoverageOptions(data=data, out=tmp_path / "out", scene=str(tmp_path / "no.yaml")))
    assert not (tmp_path / "out").exists()
