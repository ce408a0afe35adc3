from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.apps.demo import reconstruct as module
from readygo.apps.demo.reconstruct import reconstruct_room
from readygo.common.camera.captured import CapturedViews


def test_demo_films_the_room_reconstructs_the_film_and_compares_it_with_the_truth(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[:, :3, 3] = [[0, 0, 1], [1, 0, 1], [0, 1, 1], [1, 1, 1.5]]
    names = tuple(f"{number:06d}.jpg" for number in range(4))
    views = CapturedViews(
        images=names, sizes_px=np.full((4, 2), 64), K_px=np.tile(np.eye(3), (4, 1, 1)), T_world_camera=poses
    )
    called: list[Any] = []
    monkeypatch.setattr(module, "scene_capture", lambda scene, **options: called.append((scene, options["out"])))
    monkeypatch.setattr(module, "reconstruct_command", lambda video, **options: called.append((video, options["out"])))
    monkeypatch.setattr(module, "load_scene", lambda path: type("Made", (), {"views": views}))
    truth = type("Known", (), {"poses": dict(zip(names, poses, strict=True))})
    monkeypatch.setattr(module, "read_truth", lambda path: truth)
    said: list[str] = []
    report = reconstruct_room(tmp_path, "embedded", said.append)
    assert called == [("embedded", tmp_path / "walk.mp4"), (tmp_path / "walk.mp4", tmp_path / "room")]
    assert report == tmp_path / "room" / "inspect" / "report.html"
    assert said[1].startswith("readygo reconstruct")
    assert "0.0 cm off" in capsys.readouterr().err
