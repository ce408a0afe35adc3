"""From a film to a file by the command, and one line for what cannot be used."""

import json
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.avatar.capture import AvatarCaptureConfig, capture_avatar
from readygo.apps.cli import run_command
from readygo.commands import COMMANDS
from readygo.common.avatars import load_avatar, load_avatars


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
    monkeypatch.setattr("readygo.apps.avatar.extracted.contact_sheet", lambda _: np.zeros((4, 4, 3), np.uint8))
    monkeypatch.setattr("readygo.apps.avatar.extracted.turntable", lambda *_: np.zeros((4, 4, 3), np.uint8))
    out = tmp_path / "person.npz"
    run_command(COMMANDS, ["avatar", "extract", str(film), "--out", str(out), "--steps", "10", "--json"])
    report = json.loads(capsys.readouterr().out)
    assert report["steps"] == 10
    assert load_avatar(out).name == "person"
    assert {path.name for path in tmp_path.iterdir()} == {"person.npz", "person.html", "person.poses.npz"}
    assert np.load(tmp_path / "person.poses.npz")["joints_m"].shape == (8, 24, 3)


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
    for name in ("contact_sheet", "turntable"):
        monkeypatch.setattr(f"readygo.apps.avatar.extracted.{name}", lambda *_: np.zeros((4, 4, 3), np.uint8))
    argv = [str(tmp_path / "film"), "--out", str(tmp_path / "person.npz"), "--steps", "10", "--json"]
    run_command(COMMANDS, ["avatar", "extract", *argv])
    report = json.loads(capsys.readouterr().out)
    assert report["overlap"] > 0.5
    assert {path.name for path in tmp_path.iterdir()} == {"film", "person.npz", "person.html", "person.poses.npz"}


@pytest.mark.parametrize(
    ("argv", "words"),
    [
        (["nowhere", "--out", "person.npz"], "is not a folder"),
        ([".", "--out", "person.npz"], "has no poses"),
        ([".", "--out", "person.ply"], "must end in .npz"),
        ([".", "--out", "person.npz", "--checkpoint", "p.pth"], "--checkpoint needs --representation hugs, and --body"),
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
