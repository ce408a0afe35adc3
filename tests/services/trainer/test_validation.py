import numpy as np
import pytest
import torch

from readygo.common.policy import PolicySpec
from readygo.common.robot import CameraConfig, RobotConfig
from readygo.services.trainer import validation
from readygo.services.trainer.frames import FrameCache
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.samples import build_table
from readygo.services.trainer.validation import Predictions, error_metrics, predict, validation_loss

LIMITS = np.float32([1.0, 1.2])


def predictions(with_previous, without_previous):
    return Predictions(with_previous=np.float32(with_previous), without_previous=np.float32(without_previous))


@pytest.fixture
def table(source):
    return build_table(source)


def test_loss_is_of_the_predictions_without_the_previous_action_in_shares_of_the_limits():
    actions = np.float32([[0.5, 0.6], [0.0, 0.0]])
    copied = predictions(actions, actions + np.float32([0.1, 0.24]))
    assert validation_loss(copied, actions, LIMITS) == pytest.approx((0.1**2 + 0.2**2) / 2, rel=1e-5)
    honest = predictions(actions + 5, actions)
    assert validation_loss(honest, actions, LIMITS) == 0.0


def test_metrics_are_root_mean_squares_beside_those_of_trivial_predictors(table):
    samples = np.array([3, 65, 200])
    actions, previous = table.actions[samples], table.previous[samples]
    mean = np.float32([0.4, 0.1])
    errors, more_errors = np.array([0.3, -0.4]), np.array([[0.3, 0.0], [0.0, 0.0], [0.0, 0.6]])
    metrics = error_metrics(predictions(actions + errors, actions + more_errors), table, samples, mean)
    assert metrics["rmse_v_mps"] == pytest.approx(0.3, rel=1e-5)
    assert metrics["rmse_w_radps"] == pytest.approx(0.4, rel=1e-5)
    assert metrics["without_previous_rmse_v_mps"] == pytest.approx(0.3 / 3**0.5, rel=1e-5)
    baseline = np.sqrt(np.mean((mean - actions) ** 2, axis=0))
    assert metrics["mean_baseline_rmse_w_radps"] == pytest.approx(baseline[1], rel=1e-5)
    assert metrics["ratio_w"] == pytest.approx(0.4 / baseline[1], rel=1e-5)
    copied = np.sqrt(np.mean((previous - actions) ** 2, axis=0))
    assert metrics["copy_baseline_rmse_v_mps"] == pytest.approx(copied[0], rel=1e-5)
    assert metrics["validation_samples"] == 3


def test_predictions_in_batches_are_those_of_single_samples(source, table, monkeypatch):
    torch.manual_seed(0)
    model = PolicyNet(RobotConfig(camera=CameraConfig(height_px=32, width_px=64)))
    frames = FrameCache(source, height_px=32, width_px=64, limit_bytes=10**8)
    samples = np.arange(50, 90, 4)
    whole = predict(model, frames, table, samples, PolicySpec(robot=RobotConfig()))
    monkeypatch.setattr(validation, "VALIDATION_BATCH", 3)
    parts = predict(model, frames, table, samples, PolicySpec(robot=RobotConfig()))
    assert not model.training
    assert whole.with_previous.shape == whole.without_previous.shape == (10, 2)
    assert np.allclose(parts.with_previous, whole.with_previous, atol=1e-5)
    assert np.allclose(parts.without_previous, whole.without_previous, atol=1e-5)
    assert not np.allclose(whole.with_previous, whole.without_previous, atol=1e-4)


def test_first_sample_of_an_episode_has_no_previous_action_to_withhold(source, table):
    torch.manual_seed(0)
    robot = RobotConfig(camera=CameraConfig(height_px=32, width_px=64))
    model = PolicyNet(robot)
    with torch.no_grad():
        half_speed = model.normalise_previous(torch.tensor([[robot.v_max_mps / 2, 0.0]]))
    assert half_speed.abs().max() == 0, "what is withheld reads as half speed straight on"
    at_half_speed = table.previous.copy()
    at_half_speed[61] = (robot.v_max_mps / 2, 0.0)
    frames = FrameCache(source, height_px=32, width_px=64, limit_bytes=0)
    same = type(table)(**{**vars(table), "previous": at_half_speed})
    answer = predict(model, frames, same, np.array([61]), PolicySpec(robot=robot))
    assert np.allclose(answer.with_previous, answer.without_previous, atol=1e-6)
