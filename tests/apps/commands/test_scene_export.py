from pathlib import Path

import numpy as np
import pytest

from readygo.apps.cli import run_command
from readygo.commands import COMMANDS
from readygo.common.camera.captured import CapturedViews
from readygo.common.scenes import save_scene
from tests.common.scenes.small_room import small_room


def test_scene_is_exported_and_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    views = CapturedViews(
        images=("a.jpg",), sizes_px=np.array([[8, 6]]), K_px=np.eye(3)[None], T_world_camera=np.eye(4)[None]
    )
    scene = save_scene(small_room(), None, tmp_path / "room", views=views)
    out = tmp_path / "out"
    run_command(COMMANDS, ["scene", "export", str(scene.path), "--format", "transforms", "--out", str(out)])
    assert (out / "transforms.json").is_file()
    printed = capsys.readouterr().out
    assert f"transforms.json; {len(scene.cloud):,} Gaussians, 1 cameras" in printed
    with pytest.raises(SystemExit) as stop:
        run_command(COMMANDS, ["scene", "export", str(scene.path), "--format", "transforms", "--out", str(out)])
    assert stop.value.code == 2
    assert "exists already" in capsys.readouterr().err
