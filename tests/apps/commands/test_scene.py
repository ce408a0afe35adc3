import dataclasses
import json
import subprocess
import sys
from pathlib import Path

import cv2
import numpy as np
import pytest

from readygo.apps.commands.scene import scene_import, scene_inspect
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
    scene_import(source, out=tmp_path / "room", license="CC0", json=True)
    imported = json.loads(capsys.readouterr().out)
    scene_inspect(str(tmp_path / "room"), json=True)
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
    scene_import(source, out=tmp_path / "room")
    capsys.readouterr()
    scene_inspect(str(tmp_path / "room"), out=tmp_path / "pictures", radius=0.5)
    text = capsys.readouterr().out
    assert "disc of 0.5 m" in text
    assert "scene room" in text
    assert (tmp_path / "pictures" / "top.png").exists()
    assert not (tmp_path / "room" / "inspect" / "top.png").exists()
    with pytest.raises(SceneError, match="--radius"):
        scene_inspect(str(tmp_path / "room"), radius=-1.0)


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
        scene_import(tmp_path / "small.ply", out=tmp_path / "small")
    assert "\n" not in str(caught.value)
    assert "extent along y" in capsys.readouterr().out
    assert cv2.imread(str(tmp_path / "small-survey.png")).shape[2] == 3
    assert not (tmp_path / "small").exists()


def test_import_finds_up_and_crops_and_drops_huge_gaussians(furnished, tmp_path, capsys):
    huge = dataclasses.replace(furnished.select(np.arange(3)), scales_m=np.full((3, 3), 500, np.float32))
    save_ply(transform_cloud(concatenate([furnished, huge]), R_from_up("-y").T), tmp_path / "huge.ply")
    with pytest.raises(SceneError, match=r"3 of its Gaussians are huge .*--drop-bad"):
        scene_import(tmp_path / "huge.ply", out=tmp_path / "huge", up="-y")
    capsys.readouterr()
    scene_import(tmp_path / "huge.ply", out=tmp_path / "huge", up="auto", drop_bad=True, crop_z=(-1.0, 2.0), json=True)
    row = json.loads(capsys.readouterr().out)
    assert row["dropped_gaussians"] == 3
    assert row["extent_high_m"][2] <= 2.0


def test_what_the_robot_cannot_see_is_a_warning_at_import(source, tmp_path, capsys):
    (tmp_path / "robot.toml").write_text("[camera]\nmount_height_m = 9.0\n")
    scene_import(source, out=tmp_path / "room", robot=tmp_path / "robot.toml")
    out, err = capsys.readouterr()
    assert "robot's views" in out
    assert "of 24 places are blurred" in err
    assert cv2.imread(str(tmp_path / "room" / "inspect" / "findings.png")).shape[2] == 3
