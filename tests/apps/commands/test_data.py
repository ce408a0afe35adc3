import json

import cv2
import pytest

from readygo.apps.commands.data import InspectOptions, ValidateOptions, inspect, validate
from readygo.common.errors import ConfigError, DatasetError
from tests.common.dataset.episodes import write_shard


@pytest.fixture
def folder(tmp_path):
    write_shard(tmp_path, [0, 1], number=0)
    write_shard(tmp_path, [2], number=1)
    return tmp_path


def damage(folder, count) -> None:
    shard = folder / "shard-r0-00001.mcap"
    shard.unlink()
    for number in range(count):
        write_shard(folder, [0], number=10 + number)


def test_validate_says_that_a_good_dataset_is_sound(folder, capsys) -> None:
    validate(ValidateOptions(data=folder))
    assert "is sound: 3 episodes, 36 samples, 2 shards." in capsys.readouterr().out


def test_validate_prints_one_line_per_defect_and_fails(folder, capsys) -> None:
    damage(folder, 2)
    with pytest.raises(DatasetError, match="has 2 defects in 4 episodes"):
        validate(ValidateOptions(data=folder))
    lines = capsys.readouterr().out.splitlines()
    assert [line.split(":")[:2] for line in lines] == [
        ["shard-r0-00010.mcap", " duplicate"],
        ["shard-r0-00011.mcap", " duplicate"],
    ]


def test_validate_stops_listing_after_twenty(folder, capsys) -> None:
    damage(folder, 23)
    with pytest.raises(DatasetError, match=r"23 defects \(3 more not shown\)"):
        validate(ValidateOptions(data=folder))
    assert len(capsys.readouterr().out.splitlines()) == 20


def test_validate_as_json_lists_all_defects_and_fails(folder, capsys) -> None:
    damage(folder, 23)
    with pytest.raises(DatasetError):
        validate(ValidateOptions(data=folder, json=True))
    report = json.loads(capsys.readouterr().out)
    assert (report["ok"], report["episodes"], len(report["defects"])) == (False, 25, 23)
    assert set(report["defects"][0]) == {"shard", "kind", "text"}


def test_inspect_counts(folder, capsys) -> None:
    inspect(InspectOptions(data=folder, json=True))
    summary = json.loads(capsys.readouterr().out)
    assert summary["episodes"] == 3
    assert summary["samples"] == 36
    assert summary["hours"] == pytest.approx(36 / 20 / 3600, abs=5e-5)
    assert (summary["samples_per_shard_min"], summary["samples_per_shard_max"]) == (12, 24)
    assert (summary["image_height_px"], summary["image_width_px"]) == (24, 32)
    assert summary["human_visible_fraction"] == 0.5
    assert summary["replans"] == 3
    assert summary["scene"]["license"] == "CC0"
    assert summary["config"]["robot"]["radius_m"] == 0.25


def test_inspect_shows_a_table(folder, capsys) -> None:
    inspect(InspectOptions(data=folder))
    out = capsys.readouterr().out
    assert "radius_m = 0.25" in out
    assert "0 of 3 episodes blurred" in out
    assert len(out.splitlines()) < 24
    assert "episodes" in out


def test_inspect_shows_what_was_recorded(folder, tmp_path, capsys) -> None:
    inspect(InspectOptions(data=folder, sheet=tmp_path / "sheet.png"))
    assert cv2.imread(str(tmp_path / "sheet.png")).shape[1] > 6 * 256
    with pytest.raises(ConfigError, match=r"--sheet .*sheet.jpg must end in .png"):
        inspect(InspectOptions(data=folder, sheet=tmp_path / "sheet.jpg"))


def test_validate_says_how_sharp_the_pictures_are(folder, capsys) -> None:
    validate(ValidateOptions(data=folder))
    assert "0 of 3 episodes blurred" in capsys.readouterr().out
    validate(ValidateOptions(data=folder, json=True))
    assert json.loads(capsys.readouterr().out)["clarity"]["episodes_looked_at"] == 3


def test_missing_folder_is_one_clear_line(tmp_path, capsys) -> None:
    with pytest.raises(DatasetError, match="does not exist"):
        validate(ValidateOptions(data=tmp_path / "nowhere"))
    assert capsys.readouterr().err == "", "no progress is shown of what did not begin"
    with pytest.raises(DatasetError, match="does not exist"):
        inspect(InspectOptions(data=tmp_path / "nowhere"))


def test_inspect_lists_the_outputs(folder, tmp_path, capsys) -> None:
    write_shard(tmp_path / "rich", [0], outputs=("mask", "depth"))
    for data, want in ((folder, ["rgb"]), (tmp_path / "rich", ["rgb", "depth", "mask"])):
        inspect(InspectOptions(data=data, json=True))
        assert json.loads(capsys.readouterr().out)["outputs"] == want
    inspect(InspectOptions(data=tmp_path / "rich"))
    assert "rgb, depth (median), mask" in capsys.readouterr().out


def test_inspect_lists_the_labels(folder, tmp_path, capsys) -> None:
    write_shard(tmp_path / "labelled", [0], labels=True)
    for data, want in ((folder, []), (tmp_path / "labelled", ["joints", "boxes", "footprints"])):
        inspect(InspectOptions(data=data, json=True))
        assert json.loads(capsys.readouterr().out)["labels"] == want


def test_validate_counts_outputs_as_parts_of_their_samples(tmp_path, capsys) -> None:
    write_shard(tmp_path, [0, 1], outputs=("mask", "depth"))
    validate(ValidateOptions(data=tmp_path))
    assert "is sound: 2 episodes, 24 samples, 1 shards." in capsys.readouterr().out
