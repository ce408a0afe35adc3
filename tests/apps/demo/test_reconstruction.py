from pathlib import Path
from typing import Any

import pytest

from readygo.apps.cli import run_command
from readygo.apps.demo import demo
from readygo.apps.demo.reconstruction import ROOM_M, narrow, training
from readygo.commands import COMMANDS
from readygo.common.scenes.embedded.plan import FLAT
from readygo.runs.config import load_run_config
from readygo.services.reconstructor.training.config import preset


def test_room_is_one_of_the_flat() -> None:
    assert ROOM_M in {(room.x_m[0], room.y_m[0], room.x_m[1], room.y_m[1]) for room in FLAT.rooms}


def test_training_is_short_and_makes_surfaces() -> None:
    assert training().steps < preset("draft").steps
    assert training().geometry.enabled
    assert not training().transients


def test_settings_of_a_room_are_sound_and_shorter() -> None:
    usual = load_run_config(None, None)
    assert narrow(usual).episode.goal_distance_min_m < usual.episode.goal_distance_min_m
    assert narrow(usual).robot == usual.robot


def test_demo_shows_the_reconstruction_where_it_is_asked_for(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def shown(scene: Any, out: Path, *_: Any) -> Path:
        assert scene == "embedded"
        return out / "reconstruction.html"

    monkeypatch.setattr(demo, "demo_reconstruction", shown)
    monkeypatch.setattr(demo, "open_scene", str)
    monkeypatch.setattr(demo, "warm_all", lambda: None)
    run_command(COMMANDS, ["demo", "--reconstruct", "--out", str(tmp_path / "demo")])
    assert f"Open {tmp_path / 'demo' / 'reconstruction.html'}" in capsys.readouterr().out
