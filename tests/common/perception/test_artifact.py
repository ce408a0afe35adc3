from pathlib import Path

import pytest

from readygo.common.camera.config import CameraConfig
from readygo.common.errors import PolicyError
from readygo.common.perception.artifact import (
    SPEC_FILE,
    PerceptionSpec,
    load_perception_spec,
    save_perception_spec,
)
from readygo.common.robot import RobotConfig


def test_spec_comes_back(tmp_path: Path) -> None:
    robot = RobotConfig(camera=CameraConfig(height_px=72, width_px=128, mount_height_m=0.7))
    spec = PerceptionSpec(robot=robot, spacing_s=0.4, training={"data": {"scenes": {"ab": "hall"}}})
    save_perception_spec(spec, tmp_path)
    assert load_perception_spec(tmp_path) == spec


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (None, "holds no perception.toml"),
        ("format = ", "is no TOML file"),
        ('format = "other/1"', "this version reads 'readygo-perception/1'"),
        ('format = "readygo-perception/1"\nspacing_s = 0.2', "cannot be used: 'robot'"),
        ('format = "readygo-perception/1"\nspacing_s = 0.21\n[robot]', "cannot be used"),
    ],
)
def test_broken_spec_is_one_line(tmp_path: Path, text: str | None, words: str) -> None:
    if text is not None:
        (tmp_path / SPEC_FILE).write_text(text)
    with pytest.raises(PolicyError, match=words):
        load_perception_spec(tmp_path)
