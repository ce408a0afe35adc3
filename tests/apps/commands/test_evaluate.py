"""Which camera `readygo evaluate` looks through."""

import dataclasses
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from readygo.__main__ import main
from readygo.apps.commands.evaluate import make_evaluator
from readygo.apps.commands.scene_argument import open_scene
from readygo.apps.fleet.run import record
from readygo.apps.run.config import load_run_config
from readygo.apps.run.spec import make_spec
from readygo.common.camera import CameraConfig, SensorConfig
from readygo.common.dataset import Dataset
from readygo.common.episode import EpisodeSimulation
from readygo.common.messages import EpisodeMotions, HumanPlanRequest, Scenario, Split, topics
from readygo.common.policy import PolicySpec, load_spec, save_spec
from readygo.common.robot import RobotConfig
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
    evaluator = make_evaluator("embedded", load_run_config(None, trained=spec), avatars=None, seed=3, renders=True)
    eyes = Eyes(evaluator.bus, "render/0", robot=evaluator.robot, floor=evaluator.floor, timeout_s=60.0)
    key = data.episodes[0].episode
    plan = evaluator.bus.request(topics.HUMAN_PLAN, HumanPlanRequest(episode=key, static=True))
    assert plan.scenario is not None
    return np.concatenate([eyes.look([at], [""]) for at in drive_again(evaluator, plan.scenario, data)])


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


def run_config(tmp_path: Path, text: str) -> Path:
    (tmp_path / "run.toml").write_text(text)
    return tmp_path / "run.toml"


def test_what_nobody_names_is_the_policys(tmp_path: Path) -> None:
    camera = CameraConfig(height_px=72, width_px=128, distortion="fisheye", mount_height_m=0.4)
    spec = PolicySpec(robot=RobotConfig(v_max_mps=0.8, camera=camera), sensor=SensorConfig(k1=(0.0, 0.01)))
    whole = load_run_config(None, trained=spec)
    assert (whole.robot, whole.renderer.sensor) == (spec.robot, spec.sensor)
    other = load_run_config(
        run_config(tmp_path, "[robot]\nv_max_mps = 0.5\n[renderer]\ndetail = 'lod'\n"), trained=spec
    )
    assert other.robot == RobotConfig(v_max_mps=0.5, camera=camera)
    assert (other.renderer.sensor, other.renderer.detail) == (spec.sensor, "lod")
    named = load_run_config(run_config(tmp_path, "[robot.camera]\nwidth_px = 128\n[renderer.sensor]\n"), trained=spec)
    assert named.robot == RobotConfig(camera=CameraConfig(width_px=128))
    assert named.renderer.sensor == SensorConfig()


class StandIn:
    """A policy that stays where it is."""

    def __init__(self, spec: PolicySpec) -> None:
        self.spec = spec

    def start(self) -> None:
        return None

    def step(self, memories, images, previous, goals) -> np.ndarray:
        self.seen = images
        return np.zeros((len(images), 2), np.float32)


@pytest.fixture
def evaluate(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys):
    """Runs the command with a policy of a fisheye camera; returns exit code, what it printed, and the policy."""
    camera = CameraConfig(height_px=24, width_px=32, distortion="fisheye", k1=0.01)
    policy = StandIn(PolicySpec(robot=RobotConfig(camera=camera), sensor=SensorConfig(k1=(0.0, 0.02))))
    monkeypatch.setattr("readygo.apps.commands.evaluate.load_policy", lambda folder: policy)
    (tmp_path / "run.toml").write_text("[episode]\ntime_limit_s = 0.2\n")
    basics = ["embedded", "policy", "--episodes", "1", "--tasks", "static", "--methods", "policy", "--json"]

    def run(*arguments: str):
        config = () if "--config" in arguments else ("--config", str(tmp_path / "run.toml"))
        monkeypatch.setattr(sys, "argv", ["readygo", "evaluate", *basics, *config, *arguments])
        code = 0
        try:
            main()
        except SystemExit as end:
            code = int(end.code or 0)
        return code, capsys.readouterr(), policy

    return run


def test_camera_of_the_policy_looks_by_default(evaluate) -> None:
    code, printed, policy = evaluate()
    assert code == 0
    summary = json.loads(printed.out)
    assert summary["robot"]["camera"]["distortion"] == "fisheye"
    assert summary["sensor"]["k1"] == [0.0, 0.02]
    assert policy.seen.shape == (1, 24, 32, 3)


def test_another_camera_is_refused_by_name_or_taken_if_asked_for(evaluate, tmp_path: Path) -> None:
    robot = tmp_path / "robot.toml"
    robot.write_text("[camera]\nheight_px = 24\nwidth_px = 32\nhorizontal_fov_deg = 90\n")
    code, printed, _ = evaluate("--robot", str(robot))
    assert code == 2
    assert "horizontal_fov_deg 100 (the robot's: 90), distortion fisheye (the robot's: none), k1 0.01" in printed.err
    assert printed.err.count("\n") == 1
    code, printed, _ = evaluate("--robot", str(robot), "--camera", "robot")
    assert code == 0
    summary = json.loads(printed.out)
    assert summary["robot"]["camera"]["horizontal_fov_deg"] == 90.0
    assert summary["sensor"]["k1"] == []


def test_recipe_of_another_camera_is_refused(evaluate) -> None:
    code, printed, _ = evaluate("--sensor", "sensor_phone_like")
    assert code == 2
    assert "distortion fisheye (the robot's: brown_conrady)" in printed.err
    assert "sensor.exposure_ev none (the robot's: [-0.3, 0.3])" in printed.err
