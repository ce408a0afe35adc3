import dataclasses
import json

import numpy as np
import pytest

from readygo.common.camera import SensorConfig
from readygo.common.policy import load_policy
from readygo.common.robot import RobotConfig
from readygo.services.trainer.outcome import write_outcome
from readygo.services.trainer.parts import build_parts
from readygo.services.trainer.run import TrainRun
from readygo.services.trainer.train import train_policy
from tests.services.trainer.conftest import QUICK, quick


def test_run_leaves_a_policy_metrics_and_a_curve(source, tmp_path):
    metrics = train_policy(source, QUICK, tmp_path)
    assert json.loads((tmp_path / "metrics.json").read_text()) == metrics
    assert (tmp_path / "loss.svg").read_text().startswith("<svg xmlns=")
    training = load_policy(tmp_path).spec.training
    assert training["data"] == {"training_data": "data-0", "validation_data": "data-0"}
    assert training["config"]["seed"] == 0
    assert not [path for path in tmp_path.iterdir() if "part" in path.name]


def test_policy_carries_the_camera_of_its_data_and_what_varied_of_it(source, tmp_path):
    camera = dataclasses.replace(source.camera, distortion="fisheye", k1=0.01, latency_s=0.1)
    source.robot, source.sensor = RobotConfig(camera=camera), SensorConfig(k1=(0.0, 0.02))
    train_policy(source, quick(samples=64, yaw_error_rad=0.1), tmp_path)
    spec = load_policy(tmp_path).spec
    assert spec.robot.camera == camera
    assert spec.sensor == SensorConfig(k1=(0.0, 0.02))


def test_run_that_holds_nothing_out_says_nothing_of_errors(source, tmp_path):
    parts = build_parts(source, None, QUICK)
    parts[1].reservoir.episodes.clear()
    run = TrainRun(parts, source.robot, source.sensor, quick(samples=64), tmp_path, data={})
    run.go(lambda _: None)
    metrics = write_outcome(run)
    assert "rmse_v_mps" not in metrics
    assert metrics["samples_seen"] == 64
    load_policy(tmp_path)


def test_mean_baseline_is_the_spread_of_held_out_actions_around_the_training_mean(make_data, tmp_path):
    source, held_out = make_data(), make_data(seed=1)
    metrics = train_policy(source, QUICK, tmp_path, validation=held_out)
    expected = np.sqrt(np.mean((held_out.actions - source.actions.mean(0)) ** 2, axis=0))
    assert metrics["mean_baseline_rmse_v_mps"] == pytest.approx(expected[0], rel=1e-5)
    assert metrics["mean_baseline_rmse_w_radps"] == pytest.approx(expected[1], rel=1e-5)
    assert metrics["validation_episodes"] == len(held_out.episodes)


def test_samples_without_a_target_are_no_part_of_the_mean(source, tmp_path):
    run = TrainRun(build_parts(source, None, QUICK), source.robot, source.sensor, quick(samples=64), tmp_path, data={})
    run.go(lambda _: None)
    before = write_outcome(run)
    table = run.training.table
    table.targets[0], table.usable[0] = np.nan, False
    vars(table).pop("usable_samples")
    after = write_outcome(run)
    for name in ("mean_baseline_rmse_v_mps", "ratio_w"):
        assert np.isfinite(after[name])
        assert after[name] == pytest.approx(before[name], rel=0.1)
