"""From a film to a file by the command, and one line for what cannot be used."""

import json
import shutil
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar
from readygo.apps.cli import run_command
from readygo.commands import COMMANDS
from readygo.common.avatars import load_avatar, load_avatars
from readygo.runs.scene_argument import open_scene


@pytest.fixture(scope="module")
def film(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("film") / "film"
    config = AvatarCaptureConfig(motion="turn", frames=8, width_px=96, height_px=96, pose_noise_deg=1.0)
    capture_avatar(load_avatars()["hana"], folder, config, lambda _: None)
    return folder


def test_avatar_report_and_poses_are_written(
    film: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "readygo.services.reconstructor.avatars.extract.load_avatars", lambda: {"hana": load_avatars()["hana"]}
    )
    for name in ("motion_sheet", "contact_sheet", "turntable"):
        monkeypatch.setattr(f"readygo.apps.avatar.extracted.{name}", lambda *_: np.zeros((4, 4, 3), np.uint8))
    out = tmp_path / "person.npz"
    run_command(COMMANDS, ["avatar", "extract", str(film), "--out", str(out), "--steps", "10", "--json"])
    report = json.loads(capsys.readouterr().out)
    assert report["steps"] == 10
    assert load_avatar(out).name == "person"
    assert {path.name for path in tmp_path.iterdir()} == {"person.npz", "person.html", "person.poses.npz"}
    assert np.load(tmp_path / "person.poses.npz")["joints_m"].shape == (8, 24, 3)


@pytest.mark.parametrize("when", ["before", "meanwhile", "after"])
def test_ctrl_c_names_the_state_beside_the_avatar_where_there_is_any(
    when: str, film: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    work = tmp_path / "person.work"

    def interrupt(*_: object, **__: object) -> object:
        if when != "before":
            work.mkdir()
        if when == "after":
            return SimpleNamespace(avatar=load_avatars()["hana"])
        raise KeyboardInterrupt

    def stop_writing(*_: object, **__: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("readygo.services.reconstructor.extract_avatar", interrupt)
    monkeypatch.setattr("readygo.apps.commands.avatar_extract.save_avatar", stop_writing)
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["avatar", "extract", str(film), "--out", str(tmp_path / "person.npz")])
    assert stop.value.code == 130
    resumes = f"the same command resumes from the state in {work}."
    said = "nothing is saved yet." if when == "before" else resumes
    assert capsys.readouterr().err.splitlines()[-1] == f"readygo: stopped; {said}"


def test_avatar_comes_of_keypoints(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    hana = load_avatars()["hana"]
    config = AvatarCaptureConfig(
        motion="turn", frames=8, width_px=96, height_px=96, layout="plain", body="keypoints", keypoint_noise_px=0.5
    )
    capture_avatar(hana, tmp_path / "film", config, lambda _: None)
    monkeypatch.setattr("readygo.services.reconstructor.avatars.extract.load_avatars", lambda: {"hana": hana})
    monkeypatch.setattr("readygo.services.reconstructor.avatars.keypoint_poses._STAGES", ((3.0, 60), (1.0, 20)))
    for name in ("motion_sheet", "contact_sheet", "turntable"):
        monkeypatch.setattr(f"readygo.apps.avatar.extracted.{name}", lambda *_: np.zeros((4, 4, 3), np.uint8))
    argv = [str(tmp_path / "film"), "--out", str(tmp_path / "person.npz"), "--steps", "10", "--json"]
    run_command(COMMANDS, ["avatar", "extract", *argv])
    report = json.loads(capsys.readouterr().out)
    assert report["overlap"] > 0.5
    assert {path.name for path in tmp_path.iterdir()} == {"film", "person.npz", "person.html", "person.poses.npz"}


def test_avatar_comes_of_a_video_of_a_camera_that_stands_still(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    hana, side = load_avatars()["hana"], 128
    config = AvatarCaptureConfig(
        motion="turn", frames=16, width_px=side, height_px=side, layout="plain", body="keypoints", keypoint_noise_px=0.5
    )
    monkeypatch.setattr("readygo.apps.avatar.capture._SWAY_M", 0.0)
    capture_avatar(hana, tmp_path / "film", config, lambda _: None)
    writer = cv2.VideoWriter(str(tmp_path / "v.mp4"), cv2.VideoWriter.fourcc(*"mp4v"), 20.0, (side, side))
    (tmp_path / "masks").mkdir()
    for number in range(config.frames):
        writer.write(cv2.imread(str(tmp_path / "film" / "images" / f"{number:05d}.png")))
        shutil.copy(tmp_path / "film" / "masks" / f"{number:05d}.png", tmp_path / "masks" / f"{number:06d}.png")
    writer.release()
    np.savez(tmp_path / "keypoints.npz", keypoints=np.load(tmp_path / "film" / "keypoints.npz")["keypoints"])
    monkeypatch.setattr("readygo.services.reconstructor.avatars.extract.load_avatars", lambda: {"hana": hana})
    for name in ("motion_sheet", "contact_sheet", "turntable"):
        monkeypatch.setattr(f"readygo.apps.avatar.extracted.{name}", lambda *_: np.zeros((4, 4, 3), np.uint8))
    forward = np.load(tmp_path / "film" / "truth.npz")["T_world_camera"][0, :3, 2]
    stands = ["--camera.height-m", "1.35", "--camera.tilt-deg", str(np.rad2deg(np.arcsin(-forward[2])))]
    argv = [str(tmp_path / "v.mp4"), "--intrinsics", "192 192 64 64", *stands, "--steps", "10", "--json"]
    run_command(COMMANDS, ["avatar", "extract", *argv, "--out", str(tmp_path / "out" / "person.npz")])
    report = json.loads(capsys.readouterr().out)
    assert report["frames"] == 16
    assert report["height_m"] == pytest.approx(hana.height_m, rel=0.08)
    assert "the camera is taken to be 1.35 m above the floor" in report["notes"][0]
    assert {path.name for path in (tmp_path / "out").iterdir()} == {"person.npz", "person.html", "person.poses.npz"}


def test_avatar_comes_of_a_film_in_a_known_scene(
    film: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    hana = load_avatars()["hana"]
    monkeypatch.setattr("readygo.services.reconstructor.avatars.extract.load_avatars", lambda: {"hana": hana})
    for name in ("motion_sheet", "contact_sheet", "turntable"):
        monkeypatch.setattr(f"readygo.apps.avatar.extracted.{name}", lambda *_: np.zeros((4, 4, 3), np.uint8))
    options = ["--motion", "turn", "--frames", "8", "--size", "96", "96", "--pose-noise-deg", "1"]
    options += ["--scene", "embedded", "--walk-radius-m", "0.6", "--mask-noise-px", "1"]
    run_command(COMMANDS, ["avatar", "capture", "hana", *options, "--out", "film"])
    assert "readygo avatar extract film --scene embedded --out hana.npz" in capsys.readouterr().out
    like_db = []
    for place in ("embedded", str(open_scene("embedded").path / "scene.ply")):
        argv = ["film", "--scene", place, "--out", "person.npz", "--steps", "10", "--json"]
        run_command(COMMANDS, ["avatar", "extract", *argv])
        (note,) = [each for each in json.loads(capsys.readouterr().out)["notes"] if "looks like the photos" in each]
        like_db.append(float(note.split()[-2]))
    assert like_db[0] > 45.0
    assert like_db[0] > like_db[1] > 20.0, "the file lacks the sky behind the windows"
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["avatar", "extract", str(film), "--scene", "embedded", "--out", "wrong.npz"])
    assert stop.value.code == 2
    assert "the scene looks unlike the photos" in capsys.readouterr().err
    assert not list(tmp_path.glob("wrong*"))


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["nowhere", "--out", "person.npz"], "is not a folder"),
        ([".", "--out", "../person.npz"], "has no poses"),
        ([".", "--out", "person.ply"], "must end in .npz"),
        ([".", "--out", "poses.npz"], "poses.npz lies inside the input ."),
        (["film.mp4", "--out", "smpl.npz", "--body", "smpl.npz"], "smpl.npz is an input"),
        (["film", "--out", "a.npz", "--checkpoint", "seg.onnx", "--mask-model", "seg.onnx"], "seg.onnx is an input"),
        ([".", "--out", "../person.npz", "--license", "x" * 2001], "license has at most 2000 characters, got 2001"),
        ([".", "--out", "../person.npz", "--scene", "nowhere"], "nowhere"),
        (["film", "--out", "a.npz", "--checkpoint", "p.pth"], "--checkpoint needs --representation hugs, and --body"),
    ],
)
def test_mistakes_end_in_one_line(
    argv: list[str], words: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["avatar", "extract", *argv])
    assert stop.value.code == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1
    assert not list(tmp_path.iterdir())
