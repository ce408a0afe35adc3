import numpy as np
import pytest
import torch

from readygo.common.robot import RobotConfig
from readygo.services.trainer import validation
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.objective import Objective
from readygo.services.trainer.parts import build_parts, timing_of
from readygo.services.trainer.samples import Timing, episode_table
from readygo.services.trainer.validation import Predictions, error_metrics, predict, validation_loss
from tests.services.trainer.conftest import make_one, quick


def test_errors_stand_beside_those_of_mean_and_copy():
    episode = make_one()
    table, samples = episode_table(episode, RobotConfig(), Timing(spacing_steps=10)), np.array([5, 10, 20])
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
