import dataclasses
from pathlib import Path

import numpy as np
import pytest

from readygo.apps.fleet.run import record
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.dataset import Dataset
from readygo.common.episode import EpisodeSimulation
from readygo.common.errors import PolicyError, RunError, SceneError
from readygo.common.messages import EpisodeMotions, HumanPlanRequest, Scenario, Split, topics
from readygo.common.policy import PolicySpec, load_spec, save_spec
from readygo.common.robot import RobotConfig
from readygo.runs.config import load_run_config
from readygo.runs.evaluation import (
    closed_loop,
    evaluation_config,
    evaluation_settings,
    evaluation_world,
    make_evaluator,
    make_evaluator_config,
    make_request,
    references,
    spec_with_camera,
    summarize,
)
from readygo.runs.origin import DataOrigin, robot_of_policy, with_origin
from readygo.runs.scene_argument import open_scene
from readygo.runs.spec import make_spec
from readygo.services.evaluator import EXPERT, STRAIGHT_LINE, EvaluateReply, Task
from readygo.services.evaluator.eyes import Eyes

SMALL = RobotConfig(camera=CameraConfig(height_px=72, width_px=128))
SEEN = 24
"""Frames that are compared."""


@pytest.fixture(scope="module")
def phone_data(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """An episode without people, recorded losslessly with the camera of a phone."""
    config = load_run_config(None, SMALL, "sensor_phone_like")
    config = dataclasses.replace(config, renderer=dataclasses.replace(config.renderer, image_format="png"))
    folder = tmp_path_factory.mktemp("phone")
    spec = make_spec(open_scene("embedded"), None, config, seed=3, split=Split.TRAIN, static=True)
    record(spec, folder, episodes=1, workers=0)
    return Dataset([folder])


def policy_of(data: Dataset, folder: Path) -> PolicySpec:
    """What a policy that was trained on some data says of itself, after it was written and read."""
    assert data.robot is not None
    save_spec(PolicySpec(robot=data.robot, sensor=data.sensor), folder)
    return load_spec(folder)


def images_along(data: Dataset, spec: PolicySpec) -> np.ndarray:
    """What an evaluator draws for a policy whose robot drives as the recorded one did."""
    world = evaluation_world("embedded", robot_of_policy(spec), avatars=None, seed=3)
    evaluator = make_evaluator(world, renderer=world.renderer())
    eyes = Eyes(evaluator.bus, topics.render("0"), robot=evaluator.robot, floor=evaluator.floor, timeout_s=60.0)
    key = data.episodes[0].episode
    plan = evaluator.bus.request(topics.HUMAN_PLAN, HumanPlanRequest(episode=key, static=True))
    assert plan.scenario is not None
    return np.concatenate([eyes.look([at]) for at in drive_again(evaluator, plan.scenario, data)])


def drive_again(evaluator, scenario: Scenario, data: Dataset):
    motions = EpisodeMotions(humans=())
    simulation = EpisodeSimulation(scenario, motions, evaluator.robot_map, evaluator.robot, evaluator.episode_config)
    for v_mps, w_radps in data.actions[:SEEN].astype(float).tolist():
        yield simulation
        simulation.advance(v_mps, w_radps)


def statistics(images: np.ndarray) -> np.ndarray:
    """Mean and spread of every channel, mean steps along rows and columns, and the change from frame to frame."""
    values = images.astype(np.float64)
    steps = [np.abs(np.diff(values, axis=axis)).mean() for axis in (0, 1, 2)]
    return np.array([*values.mean(axis=(0, 1, 2)), *values.std(axis=(0, 1, 2)), *steps])


def test_policy_of_phone_images_is_shown_such_images_without_being_told(phone_data: Dataset, tmp_path: Path) -> None:
    recorded = np.stack([phone_data.decode(index) for index in range(SEEN)])
    spec = policy_of(phone_data, tmp_path)
    shown = images_along(phone_data, spec)
    np.testing.assert_allclose(statistics(shown), statistics(recorded), rtol=0.01)
    pinhole = images_along(phone_data, PolicySpec(robot=SMALL))
    off = np.abs(statistics(pinhole) / statistics(recorded) - 1.0)
    assert off[:3].max() > 0.03
    assert off[6:].max() > 0.1
    assert np.abs(shown.astype(int) - recorded).mean() < 0.5 * np.abs(pinhole.astype(int) - recorded).mean()


def test_another_camera_than_the_policys_is_refused_or_taken() -> None:
    spec = PolicySpec(robot=RobotConfig(height_m=0.8, camera=CameraConfig(mount_height_m=0.3)))
    other = RobotConfig(camera=CameraConfig(mount_height_m=0.6))
    with pytest.raises(PolicyError, match="mount_height_m"):
        evaluation_config(spec, "policy", config=None, robot=other, sensor=None, humans=None)
    taken = evaluation_config(spec, "robot", config=None, robot=other, sensor=None, humans=None)
    assert taken.robot == other
    assert evaluation_config(spec, "policy", config=None, robot=None, sensor=None, humans=None).robot == spec.robot


def test_robot_of_other_limits_is_refused_whatever_looks() -> None:
    spec = PolicySpec(robot=SMALL)
    fast = dataclasses.replace(SMALL, v_max_mps=2.0, alpha_max_radps2=1.5)
    for camera in ("policy", "robot"):
        with pytest.raises(
            PolicyError, match=r"v_max_mps 1 \(the robot's: 2\), alpha_max_radps2 3 \(the robot's: 1\.5\)"
        ):
            evaluation_config(spec, camera, config=None, robot=fast, sensor=None, humans=None)


def test_records_depend_on_scene_settings_policy_and_streams_but_not_on_their_number() -> None:
    world = evaluation_world("embedded", load_run_config(None, SMALL), avatars=None, seed=5)
    few = make_request(3, ("static",), ("expert",), Split.VAL, 5)
    more = make_request(9, ("dynamic",), ("straight-line",), Split.VAL, 5)
    settings = evaluation_settings(world, few, policy="ab", camera="policy")
    assert settings == evaluation_settings(world, more, policy="ab", camera="policy")
    assert (settings["scene"], settings["split"]) == (world.scene.content_hash, "val")
    assert settings != evaluation_settings(world, few, policy="cd", camera="policy")


def test_robots_camera_replaces_the_policys_but_the_rest_of_its_robot_stays() -> None:
    robot = RobotConfig(height_m=0.8, camera=CameraConfig(mount_height_m=0.3))
    spec = PolicySpec(robot=robot, sensor=SensorConfig(k1=(0.0, 0.02)))
    assert spec_with_camera(spec, "policy") is spec
    other = spec_with_camera(spec, "robot")
    assert other.robot == dataclasses.replace(robot, camera=CameraConfig())
    assert other.sensor == SensorConfig()


def test_evaluation_is_as_the_policys_data_where_nobody_names_something_else(tmp_path: Path) -> None:
    settings = {"human_planner": {"slope_max": 2.0}, "episode": {"human_count_max": 4}, "renderer": {"detail": "lod"}}
    spec = with_origin(PolicySpec(robot=SMALL), DataOrigin(settings=settings))
    asis = evaluation_config(spec, "policy", config=None, robot=None, sensor=None, humans=None)
    assert (asis.human_planner.slope_max, asis.episode.human_count_max, asis.renderer.detail) == (2.0, 4, "lod")
    (tmp_path / "run.toml").write_text('[renderer]\ndetail = "exact"\n')
    named = evaluation_config(spec, "policy", config=tmp_path / "run.toml", robot=None, sensor=None, humans="paper")
    assert named.human_planner.slope_max == 0.0
    assert named.episode.human_count_max == 2
    assert named.renderer.detail == "exact"


def test_arguments_become_a_request_or_one_line() -> None:
    request = make_request(3, ("dynamic",), ("expert", "straight-line"), Split.VAL, 7)
    assert (request.tasks, request.methods) == ((Task.DYNAMIC,), (EXPERT, STRAIGHT_LINE))
    assert (request.episodes, request.seed, request.split) == (3, 7, Split.VAL)
    with pytest.raises(RunError, match=r"^These arguments make no evaluation: tasks and methods must not repeat"):
        make_request(3, ("static", "static"), ("expert",), Split.VAL, 0)
    with pytest.raises(RunError, match=r"evaluation: seed must be at least 0, got -2\.$"):
        make_request(3, ("static",), ("expert",), Split.VAL, -2)
    with pytest.raises(RunError, match=r"evaluation: episodes must be at least 1, got 0\.$"):
        make_request(0, ("static",), ("expert",), Split.VAL, 0)
    assert make_evaluator_config(3).lockstep == 3
    with pytest.raises(RunError, match="lockstep"):
        make_evaluator_config(0)


def test_summary_says_on_what_was_measured() -> None:
    config = load_run_config(None, SMALL)
    evaluator = make_evaluator(evaluation_world("embedded", config, avatars=None, seed=5))
    request = make_request(3, ("static",), ("expert",), Split.VAL, 5)
    summary = summarize(EvaluateReply(records=(), summaries={}, skipped=2), request, evaluator)
    assert {name: summary[name] for name in ("episodes", "seed", "split", "skipped", "policy_training")} == {
        "episodes": 3,
        "seed": 5,
        "split": "val",
        "skipped": 2,
        "policy_training": None,
    }
    assert summary["robot"]["camera"]["width_px"] == 128


def test_closed_loop_validation_that_cannot_work_is_refused_before_training(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="episodes must be at least 1, got 0"):
        closed_loop("embedded", episodes=0, seed=0)
    with pytest.raises(SceneError, match="does not exist"):
        closed_loop(str(tmp_path / "nowhere"), episodes=1, seed=0)


class ReachedError(Exception):
    pass


def test_checkpoints_are_measured_with_the_camera_of_the_policy(monkeypatch: pytest.MonkeyPatch) -> None:
    robot = RobotConfig(camera=CameraConfig(distortion="fisheye", mount_pitch_deg=5.0))
    spec = PolicySpec(robot=robot, sensor=SensorConfig(vignetting=(0.0, 0.2)))
    configs = []

    def evaluation_world(scene, config, **settings) -> None:
        configs.append(config)
        raise ReachedError

    monkeypatch.setattr("readygo.runs.evaluation.evaluation_world", evaluation_world)
    monkeypatch.setattr("readygo.runs.evaluation.load_policy", lambda folder: type("Policy", (), {"spec": spec}))
    with pytest.raises(ReachedError):
        closed_loop("embedded", episodes=1, seed=0)(Path("policy"))
    assert configs[0].robot == robot
    assert configs[0].renderer.sensor == spec.sensor


def test_others_are_compared_with_the_first_method_and_the_expert() -> None:
    assert references(("policy", STRAIGHT_LINE, EXPERT)) == ["policy", EXPERT]
    assert references((EXPERT, "policy")) == [EXPERT]
    assert references((STRAIGHT_LINE, "policy")) == [STRAIGHT_LINE]
    assert references(()) == []
