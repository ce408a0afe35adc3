from pathlib import Path

import pytest

from readygo.apps.commands import evaluate as evaluate_command
from readygo.apps.commands.train import closed_loop
from readygo.apps.demo.demo import _clear
from readygo.apps.run.config import RunConfig
from readygo.common.config import section_from_mapping
from readygo.common.errors import ConfigError, RunError, SceneError
from readygo.common.policy.artifact import PolicySpec
from readygo.common.robot import RobotConfig


def test_demo_refuses_a_folder_that_no_demo_has_made(tmp_path: Path) -> None:
    (tmp_path / "data").mkdir()
    (tmp_path / "data" / "shard-rec0-00000.mcap").write_text("precious")
    with pytest.raises(RunError, match="holds files of something else"):
        _clear(tmp_path)
    assert (tmp_path / "data" / "shard-rec0-00000.mcap").read_text() == "precious"


def test_demo_replaces_an_earlier_demo(tmp_path: Path) -> None:
    _clear(tmp_path / "demo")
    (tmp_path / "demo" / "data").mkdir()
    _clear(tmp_path / "demo")
    assert not (tmp_path / "demo" / "data").exists()


def test_closed_loop_validation_that_cannot_work_is_refused_before_training(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="one or more episodes"):
        closed_loop("embedded", episodes=0, seed=0)
    with pytest.raises(SceneError, match="does not exist"):
        closed_loop(str(tmp_path / "nowhere"), episodes=1, seed=0)


def test_setting_that_must_be_an_array_is_refused_by_name() -> None:
    with pytest.raises(ConfigError, match=r"expert\.lookahead_m must be an array, got 0\.5"):
        section_from_mapping(RunConfig, {"expert": {"lookahead_m": 0.5}})
    with pytest.raises(ConfigError, match=r"^robot: radius_m must be positive"):
        section_from_mapping(RunConfig, {"robot": {"radius_m": -1.0}})


@pytest.mark.parametrize(
    ("text", "height_m"), [("[episode]\ntime_limit_s = 40.0\n", 0.9), ("[robot]\nheight_m = 0.8\n", 0.8)]
)
def test_policys_robot_drives_unless_the_configuration_names_another(
    text: str, height_m: float, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class StoppedError(Exception):
        pass

    def evaluator(scene: str, config: RunConfig, **_: object) -> None:
        assert config.robot.height_m == height_m
        raise StoppedError

    class Trained:
        spec = PolicySpec(robot=RobotConfig(height_m=0.9))

    config = tmp_path / "run.toml"
    config.write_text(text)
    monkeypatch.setattr(evaluate_command, "load_policy", lambda _: Trained())
    monkeypatch.setattr(evaluate_command, "make_evaluator", evaluator)
    with pytest.raises(StoppedError):
        evaluate_command.evaluate("embedded", tmp_path, config=config)
