import numpy as np
import pytest
import torch

from readygo.common.robot import RobotConfig
from readygo.services.trainer import validation
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.objective import Objective
from readygo.services.trainer.parts import build_parts, timing_of
from readygo.services.trainer.samples import WindowTiming, episode_table
from readygo.services.trainer.validation import Predictions, error_metrics, predict, validation_loss
from tests.services.trainer.conftest import make_one, quick


def test_errors_stand_beside_those_of_mean_and_copy():
    episode = make_one()
    table, samples = episode_table(episode, RobotConfig(), WindowTiming(spacing_steps=10)), np.array([5, 10, 20])
    actions, previous = episode.actions[samples], episode.actions[samples - 1]
    predictions = Predictions(given=actions + np.float32(0.1), withheld=actions + np.float32(0.4))
    metrics = error_metrics(predictions, table, samples, np.zeros(2, np.float32))
    assert metrics["rmse_v_mps"] == pytest.approx(0.1, rel=1e-4)
    assert metrics["without_previous_rmse_w_radps"] == pytest.approx(0.4, rel=1e-4)
    baseline = np.sqrt(np.mean(actions**2, axis=0))
    assert metrics["mean_baseline_rmse_v_mps"] == pytest.approx(baseline[0], rel=1e-5)
    assert metrics["ratio_w"] == pytest.approx(0.1 / baseline[1], rel=1e-3)
    copied = np.sqrt(np.mean((previous - actions) ** 2, axis=0))
    assert metrics["copy_baseline_rmse_v_mps"] == pytest.approx(copied[0], rel=1e-5)
    assert metrics["validation_samples"] == 3


def test_loss_is_of_what_is_answered_without_the_previous_action():
    actions = np.zeros((4, 2), np.float32)
    predictions = Predictions(given=actions, withheld=actions + np.float32([0.5, 0.6]))
    assert validation_loss(predictions, actions, np.array([1.0, 1.2])) == pytest.approx(0.25)


@pytest.mark.parametrize("motion", ["poses", "command"])
def test_predictions_in_batches_are_those_of_single_samples(source, monkeypatch, motion):
    config = quick(motion=motion)
    torch.manual_seed(0)
    model = PolicyNet(source.robot, config.network)
    objective = Objective(source.robot, config, timing_of(source.robot, config), torch.float32)
    part, samples = build_parts(source, None, config)[0], np.arange(50, 90, 4)
    whole = predict(model, objective, part, samples)
    monkeypatch.setattr(validation, "VALIDATION_BATCH", 3)
    parts = predict(model, objective, part, samples)
    assert not model.training
    assert whole.given.shape == whole.withheld.shape == (10, 2)
    assert np.allclose(parts.given, whole.given, atol=1e-5)
    assert np.allclose(parts.withheld, whole.withheld, atol=1e-5)
    assert np.allclose(whole.given, whole.withheld, atol=1e-4) == (motion == "poses")


def test_every_error_is_that_of_its_own_axis():
    episode = make_one()
    table, samples = episode_table(episode, RobotConfig(), WindowTiming(spacing_steps=10)), np.array([4, 9, 17, 31])
    actions = episode.actions[samples]
    predictions = Predictions(given=actions + np.float32([0.1, -0.3]), withheld=actions + np.float32([-0.2, 0.7]))
    mean = np.float32([0.4, -0.1])
    metrics = error_metrics(predictions, table, samples, mean)
    off = np.sqrt(np.mean((mean - actions) ** 2, axis=0))
    wanted = {
        "rmse_v_mps": 0.1,
        "rmse_w_radps": 0.3,
        "without_previous_rmse_v_mps": 0.2,
        "without_previous_rmse_w_radps": 0.7,
        "mean_baseline_rmse_v_mps": off[0],
        "mean_baseline_rmse_w_radps": off[1],
        "ratio_v": 0.1 / off[0],
        "ratio_w": 0.3 / off[1],
        "without_previous_ratio_v": 0.2 / off[0],
        "without_previous_ratio_w": 0.7 / off[1],
    }
    for name, value in wanted.items():
        assert metrics[name] == pytest.approx(value, rel=1e-4), name


def test_mean_that_is_never_off_gives_a_ratio_of_none():
    episode = make_one(actions=np.full((40, 2), 0.5, np.float32))
    table, samples = episode_table(episode, RobotConfig(), WindowTiming(spacing_steps=10)), np.array([3, 5])
    given = np.zeros((2, 2), np.float32)
    metrics = error_metrics(Predictions(given=given, withheld=given), table, samples, np.full(2, 0.5, np.float32))
    assert (metrics["ratio_v"], metrics["without_previous_ratio_w"]) == (0.0, 0.0)


def test_loss_counts_both_axes_in_units_of_each_robots_limits():
    targets, limits = np.zeros((2, 2), np.float32), np.array([[0.5, 2.0], [2.0, 0.5]])
    predictions = Predictions(given=targets, withheld=np.float32([[0.5, 0.5], [1.0, 1.0]]))
    assert validation_loss(predictions, targets, limits) == pytest.approx((1 + 1 / 16 + 1 / 4 + 4) / 4)
