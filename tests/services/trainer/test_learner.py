import copy
import math

import numpy as np
import pytest
import torch

from readygo.common.errors import PolicyError
from readygo.services.trainer.learner import Learner
from readygo.services.trainer.parts import build_parts
from readygo.services.trainer.ranks import Ranks
from tests.services.trainer.conftest import quick


@pytest.fixture
def make_learner(source):
    def make(**settings):
        config = quick(**settings)
        part = build_parts(source, None, config)[0]
        learner = Learner(source.robot, config, Ranks())
        shown = learner.objective.training(part.table, part.frames, np.arange(32), np.random.default_rng(0))
        return learner, shown

    return make


@pytest.mark.parametrize(("ema_decay", "kept"), [(0.99, 2 / 11), (0.05, 0.05), (0.0, 0.0)])
def test_average_of_the_weights_follows_them_faster_at_first(make_learner, ema_decay, kept):
    learner, shown = make_learner(ema_decay=ema_decay)
    before = learner.average.head.layer1.weight.clone()
    learner.learn(shown, 0.01, 0)
    after = learner.model.head.layer1.weight.detach()
    assert (after - before).abs().max() > 1e-5
    assert torch.allclose(learner.average.head.layer1.weight, kept * before + (1 - kept) * after, atol=1e-7)


def test_steps_lower_the_loss_of_a_batch(make_learner):
    for precision in ("fp32", "bf16"):
        learner, shown = make_learner(precision=precision)
        losses = [learner.learn(shown, 1e-3, step) for step in range(12)]
        assert losses[-1] < 0.5 * losses[0]


def test_batch_whose_loss_is_no_number_changes_no_weight(make_learner):
    learner, shown = make_learner()
    before = learner.model.head.layer1.weight.clone()
    shown.goals_xy_m[3] = math.nan
    assert math.isnan(learner.learn(shown, 0.01, 0))
    assert torch.equal(learner.model.head.layer1.weight, before)
    assert learner.is_finite
    learner.model.head.layer1.weight.data[0, 0] = math.inf
    assert not learner.is_finite


def test_state_goes_on_where_it_was_taken(make_learner):
    learner, shown = make_learner()
    learner.learn(shown, 0.01, 0)
    other, _ = make_learner(seed=1)
    other.restore(copy.deepcopy(learner.state()))
    for each in (learner, other):
        each.learn(shown, 0.01, 1)
    for name, value in learner.average.state_dict().items():
        assert torch.equal(value, other.average.state_dict()[name])


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_device_that_is_not_there_is_refused(make_learner):
    with pytest.raises(PolicyError, match="no CUDA device"):
        make_learner(device="cuda")
