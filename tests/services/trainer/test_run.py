import dataclasses
from types import SimpleNamespace

import pytest
import torch

from readygo.services.trainer import TrainConfig, paper_recipe
from readygo.services.trainer.model import PolicyNet
from readygo.services.trainer.run import TrainRun, learning_rate

ONE_BATCH = TrainConfig(
    epochs=1, threads=1, batch_size=1000, validation_samples=60, previous_noise=0.0, previous_dropout=0.0
)
LEFT = torch.tensor([1.0, -1.0])


@pytest.fixture
def first_batch(source, tmp_path, monkeypatch):
    """What the network is shown, and what it is to answer, in the first step of a run."""

    def show(**settings):
        shown = []
        forward, loss = PolicyNet.forward, torch.nn.functional.mse_loss

        def watched_forward(self, images, window, previous, goals):
            shown.append(SimpleNamespace(images=images.clone(), previous=previous.clone(), goals=goals.clone()))
            return forward(self, images, window, previous, goals)

        def watched_loss(answers, wanted):
            shown[-1].wanted = wanted.clone()
            return loss(answers, wanted)

        with monkeypatch.context() as patch:
            patch.setattr(PolicyNet, "forward", watched_forward)
            patch.setattr(torch.nn.functional, "mse_loss", watched_loss)
            config = dataclasses.replace(ONE_BATCH, **settings)
            out = tmp_path / str(len(list(tmp_path.iterdir())))
            TrainRun(source, config, out, validation=None, evaluate=None).go(lambda _: None)
        return shown[0]

    return show


def test_mirrored_batch_is_the_flipped_image_with_goal_and_turn_rates_to_the_other_side(first_batch):
    plain, mirrored = first_batch(mirror=0.0), first_batch(mirror=1.0)
    assert plain.goals.abs().min() > 0
    assert plain.wanted[:, 1].abs().max() > 0.5
    assert not torch.equal(plain.images, plain.images.flip(3))
    assert torch.equal(mirrored.images, plain.images.flip(3))
    assert torch.equal(mirrored.goals, plain.goals * LEFT)
    assert torch.equal(mirrored.wanted, plain.wanted * LEFT)
    assert torch.allclose(mirrored.previous, plain.previous * LEFT, atol=1e-6)


def test_wanted_answers_are_the_recorded_actions_as_shares_of_the_limits(first_batch, source):
    shown = first_batch(mirror=0.0, yaw_error_rad=0.0, hindsight=0.0)
    v_mps = {round(v, 5) for v in source.actions[:, 0].tolist()}
    assert {round(v, 5) for v in shown.wanted[:, 0].tolist()} <= v_mps
    rates = {round(w / 1.2, 5) for w in source.actions[:, 1].tolist()}
    assert {round(w, 5) for w in shown.wanted[:, 1].tolist()} <= rates


@pytest.mark.parametrize(("ema_decay", "kept"), [(0.99, 0.1), (0.05, 0.05), (0.0, 0.0)])
def test_average_of_the_weights_follows_them_faster_at_first(source, tmp_path, ema_decay, kept):
    config = dataclasses.replace(ONE_BATCH, ema_decay=ema_decay, learning_rate=0.01)
    run = TrainRun(source, config, tmp_path, validation=None, evaluate=None)
    before = run.average.head.layer1.weight.clone()
    run.go(lambda _: None)
    after = run.model.head.layer1.weight.detach()
    assert run.step == 1
    assert (after - before).abs().max() > 1e-5
    assert torch.allclose(run.average.head.layer1.weight, kept * before + (1 - kept) * after, atol=1e-7)


def test_learning_rate_warms_up_and_falls():
    rates = [learning_rate(TrainConfig(), step, step / 1000) for step in range(1001)]
    assert rates[0] < 0.1 * max(rates)
    assert rates[-1] == pytest.approx(1e-5)
    assert learning_rate(paper_recipe(TrainConfig()), 500, 0.5) == 1e-4
