import dataclasses
import functools
import json
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from readygo.apps.commands import scene as command
from readygo.apps.commands.scene import (
    ImportGeometryOptions,
    SceneImportOptions,
    SceneInspectOptions,
    scene_import,
    scene_inspect,
)
from readygo.common.errors import SceneError
from readygo.common.gaussians import R_from_up, concatenate, save_ply, transform_cloud
from tests.common.maps.room import box, room

ROOT = Path(__file__).resolve().parents[3]


@pytest.fixture(scope="module")
def source(tmp_path_factory):
    path = tmp_path_factory.mktemp("files") / "room.ply"
    save_ply(concatenate([room(4.0, 3.0), box((1, 1, 0), (1.4, 1.4, 0.5))]), path)
    return path


def test_import_then_inspect_prints_json_and_draws(source, tmp_path, capsys):
    scene_import(SceneImportOptions(source=source, out=tmp_path / "room", license="CC0", json=True))
    imported = json.loads(capsys.readouterr().out)
    scene_inspect(SceneInspectOptions(scene=str(tmp_path / "room"), json=True))
    inspected = json.loads(capsys.readouterr().out)
    assert inspected["content_hash"] == imported["content_hash"]
    assert inspected["license"] == "CC0"
    assert inspected["views"] == imported["views"]
    assert len(inspected["views"]["places"]) == 24
    assert inspected["robot"]["radius_m"] == 0.3
    assert 4 < inspected["robot"]["reachable_m2"] < 12
    assert [Path(p).name for p in inspected["pictures"]] == [
        "top.png",
        "map_robot.png",
        "map_human.png",
        "views.png",
        "map_views.png",
        "findings.png",
    ]
    for picture in inspected["pictures"]:
        assert cv2.imread(picture).shape[2] == 3
    assert inspected["findings"] == imported["findings"]
    assert sorted(p.name for p in (tmp_path / "room" / "inspect").iterdir()) == [
        "findings.png",
        "map_human.png",
        "map_robot.png",
        "map_views.png",
        "top.png",
        "views.png",
    ]


def test_inspect_prints_a_table_and_takes_radius_and_folder(source, tmp_path, capsys):
    scene_import(SceneImportOptions(source=source, out=tmp_path / "room"))
    capsys.readouterr()
    scene_inspect(SceneInspectOptions(scene=str(tmp_path / "room"), out=tmp_path / "pictures", radius=0.5))
    text = capsys.readouterr().out
    assert "disc of 0.5 m" in text
    assert "scene room" in text
    assert text.splitlines()[-1] == "All files match the hashes of the manifest."
    assert (tmp_path / "pictures" / "top.png").exists()
    assert not (tmp_path / "room" / "inspect" / "top.png").exists()
    with pytest.raises(SceneError, match="--radius"):
        scene_inspect(SceneInspectOptions(scene=str(tmp_path / "room"), radius=-1.0))
    data = bytearray((tmp_path / "room" / "scene.ply").read_bytes())
    data[-1] ^= 1
    (tmp_path / "room" / "scene.ply").write_bytes(data)
    with pytest.raises(SceneError, match=r"is damaged: scene\.ply has changed; import the scene again"):
        scene_inspect(SceneInspectOptions(scene=str(tmp_path / "room"), out=tmp_path / "pictures"))


def test_command_line_reports_a_mistake_in_one_line(tmp_path):
    (tmp_path / "a.ply").write_bytes(b"nothing")
    command = [
        sys.executable,
        "-m",
        "readygo",
        "scene",
        "import",
        str(tmp_path / "a.ply"),
        "--out",
        str(tmp_path / "b"),
    ]
    done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert len(done.stderr.strip().splitlines()) == 1
    assert "is none of what can be read" in done.stderr
    assert not (tmp_path / "b").exists()


@pytest.fixture(scope="module")
def furnished():
    return concatenate(
        [room(), box((1, 1, 0), (2, 1.5, 0.8)), box((3, 3, 0), (4.5, 4, 0.5)), box((5, 1, 0), (5.5, 2, 1))]
    )


def test_failed_import_shows_what_the_file_holds_and_what_to_try(furnished, tmp_path, capsys):
    on_its_side = transform_cloud(furnished, R_from_up("-y").T, scale=0.01)
    save_ply(on_its_side, tmp_path / "small.ply")
    with pytest.raises(SceneError, match=r"Try --up=-y --scale .*small-survey\.png") as caught:
        scene_import(SceneImportOptions(source=tmp_path / "small.ply", out=tmp_path / "small"))
    assert "\n" not in str(caught.value)
    assert "extent along y" in capsys.readouterr().out
    assert cv2.imread(str(tmp_path / "small-survey.png")).shape[2] == 3
    assert not (tmp_path / "small").exists()


def test_import_finds_up_and_crops_and_drops_huge_gaussians(furnished, tmp_path, capsys):
    huge = dataclasses.replace(furnished.select(np.arange(3)), scales_m=np.full((3, 3), 500, np.float32))
    save_ply(transform_cloud(concatenate([furnished, huge]), R_from_up("-y").T), tmp_path / "huge.ply")
    with pytest.raises(SceneError, match=r"3 of its Gaussians are huge .*--drop-bad"):
        scene_import(SceneImportOptions(source=tmp_path / "huge.ply", out=tmp_path / "huge", up="-y"))
    capsys.readouterr()
    scene_import(
        SceneImportOptions(
            source=tmp_path / "huge.ply",
            out=tmp_path / "huge",
            up="auto",
            drop_bad=True,
            json=True,
            geometry=ImportGeometryOptions(crop_z=(-1.0, 2.0)),
        )
    )
    row = json.loads(capsys.readouterr().out)
    assert row["dropped_gaussians"] == 3
    assert row["extent_high_m"][2] <= 2.0


def test_what_the_robot_cannot_see_is_a_warning_at_import(source, tmp_path, capsys):
    (tmp_path / "robot.toml").write_text("[camera]\nmount_height_m = 9.0\n")
    scene_import(SceneImportOptions(source=source, out=tmp_path / "room", robot=tmp_path / "robot.toml"))
    out, err = capsys.readouterr()
    assert "robot's views" in out
    assert "of 24 places are blurred" in err
    assert cv2.imread(str(tmp_path / "room" / "inspect" / "findings.png")).shape[2] == 3


def test_rows_tell_the_numbers_of_a_scene():
    area = {"reachable_m2": 12.36, "free_m2": 23.45, "radius_m": 0.35}
    report = {
        "extent_low_m": (-1.0, 2.0, -0.5), "extent_high_m": (3.26, 9.5, 2.0), "gaussians": 98765, "sh_degree": 3,
        "sky_gaussians": 4321, "opacity_median": 0.876, "opacity_below_0p1_share": 0.236,
        "floor": {"low_m": -0.126, "high_m": 0.056, "tilt_deg": 1.236}, "robot": area,
        "human": {"reachable_m2": 1.0, "free_m2": 2.0, "radius_m": 0.25},
    }  # fmt: skip
    assert command._rows(report) == [
        ("Gaussians", "98,765, SH degree 3; sky 4,321"),
        ("extent (99 %)", "4.3 x 7.5 x 2.5 m"),
        ("opacity", "median 0.88; below 0.1: 24 %"),
        ("floor", "z -0.13..0.06 m, tilt 1.24 deg"),
        ("robot area", "12.4 m2 connected for a disc of 0.35 m; 23.4 m2 clear"),
        ("human area", "1.0 m2 connected for a disc of 0.25 m; 2.0 m2 clear"),
    ]
    seen = SimpleNamespace(sharpness=123.6, coverage=0.876, places=[1, 2, 3])
    assert command._view_summary(seen) == "sharpness 124, surface 88 % of the view (medians of 3 places)"


def test_survey_is_told_with_what_to_try_and_remedies_for_what_is_unwanted(monkeypatch):
    up = SimpleNamespace(name="-y", floor=1.236, ceiling=2.567, above=0.876, score=0.01236)
    scale = SimpleNamespace(metres_per_unit=0.0123, reason="as a room")
    found = SimpleNamespace(
        gaussians=98765, low=(-1.23456, 0.0, 2.0), high=(4.56789, 1.0, 3.0), scales=[scale],
        likely_ups=[up, SimpleNamespace(name="+z", floor=0.0, ceiling=None, above=1.0, score=0.5)],
    )  # fmt: skip
    assert command._survey_rows(found, "none") == [
        ("Gaussians", "98,765; unwanted: none"),
        ("extent along x (98 %)", "-1.235 .. 4.568 units of the file"),
        ("extent along y (98 %)", "0 .. 1 units of the file"),
        ("extent along z (98 %)", "2 .. 3 units of the file"),
        ("--up=-y", "floor at 1.24, ceiling 2.57 above it; 88 % of the scene above it; score 12.4"),
        ("--up=+z", "floor at 0; 100 % of the scene above it; score 500.0"),
        ("--scale 0.0123", "as a room"),
    ]
    told = []
    monkeypatch.setattr(command, "advice", lambda *words: told.append(words) or "Try.")
    share = command.SHARES_WORTH_NAMING[command.FLOATERS]
    few = np.arange(1000) < 1000 * share
    masks = {command.HUGE: np.zeros(1000, bool), command.FLOATERS: few}
    assert command._remedy(found, "+z", 2.0, masks, Path("a/b.part.ply")) == "Try."
    assert told == [(found, "+z", 2.0)]
    masks = {command.HUGE: np.arange(1000) < 3, command.FLOATERS: np.arange(1000) < 1000 * share + 1}
    count = int(masks[command.FLOATERS].sum())
    assert command._remedy(found, "+z", 2.0, masks, Path("a/b.part.ply")) == (
        f"{count:,} of its 98,765 Gaussians float and may fill it: "
        "`readygo scene clean a/b.part.ply --out a/b-clean.ply` removes them. "
        "Try. 3 of its Gaussians are huge and cover all: --drop-bad leaves them out."
    )


def test_scene_is_told_with_all_that_is_known_of_it(monkeypatch, capsys):
    monkeypatch.setattr(command, "_rows", lambda report: [("first", report["word"])])
    monkeypatch.setattr(command, "warnings", lambda seen: ["[it] is foggy"])
    monkeypatch.setattr(command, "PlainConsole", functools.partial(command.PlainConsole, width=120))
    seen = SimpleNamespace(sharpness=123.6, coverage=0.876, places=(1, 2, 3), to_mapping=lambda: {"sharp": 1})
    scene = SimpleNamespace(
        name="hall", path=Path("hall"), content_hash="abc", license="", views=[0] * 1234,
        metadata={"source": {"dropped_gaussians": 5678}},
    )  # fmt: skip
    report = {"word": "value", "findings": ["look [there]"]}
    command._print(scene, report, seen, [Path("a.png"), Path("b.png")], json=False)
    printed = capsys.readouterr()
    rows = [[cell.strip() for cell in line.strip("│").split("│")] for line in printed.out.splitlines() if "│" in line]
    assert rows == [
        ["first", "value"],
        ["robot's views", "sharpness 124, surface 88 % of the view (medians of 3 places)"],
        ["left out", "5,678 Gaussians that cannot be drawn"],
        ["look here", "look [there]"],
        ["filmed by", "1,234 cameras"],
        ["license", "not given"],
        ["bundle", "hall"],
        ["picture", "a.png"],
        ["picture", "b.png"],
    ]
    assert printed.err == "Warning: [it] is foggy\n"
    command._print(scene, report, seen, [Path("a.png")], json=True)
    assert json.loads(capsys.readouterr().out) == {
        "name": "hall", "path": "hall", "content_hash": "abc", "license": "", "dropped_gaussians": 5678,
        "cameras": 1234, **report, "views": {"sharp": 1}, "pictures": ["a.png"],
    }  # fmt: skip
