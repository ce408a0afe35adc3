import dataclasses
import json
from pathlib import Path

import pytest

from readygo.apps.learn import perceive_plan as module
from readygo.apps.learn.perceive_plan import STATE_FILE, PerceivePlan, check_plan, perceive_settings
from readygo.common.camera import CameraConfig
from readygo.common.errors import AvatarError, ConfigError, RunError
from readygo.common.robot import RobotConfig
from readygo.common.robot.ranges import RobotRanges
from readygo.services.driver import DriverConfig
from tests.apps.learn.perceive_plans import plan_of


def test_settings_are_for_perception_and_the_test_is_without_them() -> None:
    config = perceive_settings(None, None, {"renderer": {"labels": True}})
    assert (config.robot, config.driver.camera_hz, config.renderer.labels) == (RobotConfig(), 5.0, True)
    assert module.tested_settings(config).driver == DriverConfig()
    assert module.tested_settings(config).robot == config.robot


@pytest.mark.parametrize(
    ("scenes", "minutes", "words"),
    [
        ((), 10.0, "Name a scene"),
        (("embedded", "embedded"), 10.0, "named twice"),
        (("embedded",), 0.0, "--minutes must be above 0, got 0"),
    ],
)
def test_plan_that_makes_no_sense_is_refused_and_leaves_nothing(
    scenes: tuple[str, ...], minutes: float, words: str, tmp_path: Path
) -> None:
    plan = PerceivePlan(
        out=tmp_path / "run", scenes=scenes, config=perceive_settings(None, None), minutes=minutes, avatars=None, seed=0
    )
    with pytest.raises(RunError, match=words):
        check_plan(plan)
    assert not plan.out.exists()


def test_usual_robot_is_that_of_the_caller_unless_a_file_has_another_camera(tmp_path: Path) -> None:
    usual = RobotConfig(camera=CameraConfig(height_px=72, width_px=128))
    assert perceive_settings(None, None, usual=usual).robot == usual
    robot = tmp_path / "robot.toml"
    robot.write_text("radius_m = 0.2\n")
    own = perceive_settings(None, robot, usual=usual).robot
    assert (own.radius_m, own.camera) == (0.2, usual.camera)
    assert perceive_settings(None, robot).robot.camera == RobotConfig().camera


def test_robot_that_perception_is_not_for_is_refused(tmp_path: Path) -> None:
    robot = RobotConfig(ranges=RobotRanges(radius_m=(0.2, 0.3)))
    plan = plan_of(tmp_path / "run")
    with pytest.raises(ConfigError, match="not for a robot of ranges: use --form policy"):
        check_plan(dataclasses.replace(plan, config=dataclasses.replace(plan.config, robot=robot)))
    assert not plan.out.exists()


def test_folder_of_something_else_is_refused(tmp_path: Path) -> None:
    (tmp_path / "notes").write_text("mine")
    with pytest.raises(RunError, match="holds files of something else"):
        check_plan(plan_of(tmp_path))
    (tmp_path / STATE_FILE).write_text(json.dumps({"format": module.FORMAT, "scenes": ["other"]}))
    with pytest.raises(RunError, match="learns in other scenes"):
        check_plan(plan_of(tmp_path))
    (tmp_path / STATE_FILE).write_text("{")
    with pytest.raises(RunError, match="cannot be read"):
        check_plan(plan_of(tmp_path))


@pytest.mark.parametrize(("minutes", "count"), [(0.2, 56), (20, 80), (50, 200), (90, 200)])
def test_longer_runs_have_more_varied_people(minutes: float, count: int) -> None:
    assert module.variants_of(minutes) == count


def test_missing_avatars_are_refused_before_anything_is_written(tmp_path: Path) -> None:
    plan = dataclasses.replace(plan_of(tmp_path / "run"), avatars=tmp_path / "none")
    with pytest.raises(AvatarError, match="does not exist"):
        check_plan(plan)
    assert not plan.out.exists()


def test_one_core_has_no_policy_on_states(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(module, "available_cores", lambda: 3)
    assert module.has_policy_on_states(plan_of(tmp_path, "a", "b"))
    assert module.workers_of(plan_of(tmp_path, "a")) == 2
    without = dataclasses.replace(plan_of(tmp_path, "a"), policy_on_states=False)
    assert not module.has_policy_on_states(without)
    assert module.workers_of(without) == 3
    monkeypatch.setattr(module, "available_cores", lambda: 1)
    assert not module.has_policy_on_states(plan_of(tmp_path, "a"))
    assert module.workers_of(plan_of(tmp_path, "a")) == 1
