from pathlib import Path

import pytest

from readygo.apps.commands import import_log as command
from readygo.apps.commands.import_log import ImportLogOptions, import_log
from readygo.apps.robot_logs.convert import Converted, LogTopics


def test_topics_reach_the_conversion(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    asked = []
    monkeypatch.setattr(
        command,
        "convert",
        lambda *given, **more: asked.append(given[2]) or Converted(episodes=2, samples=80, drift_m=0.02),
    )
    import_log(ImportLogOptions(log=tmp_path, out=tmp_path / "out", image="/a", odom="/b", camera_info="/c"))
    assert asked == [LogTopics(image="/a", odometry="/b", camera_info="/c")]
    assert "2 episodes, 80 samples, at most 0.02 m off" in capsys.readouterr().out
