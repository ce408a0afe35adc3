import numpy as np
import pytest

from readygo.common.state_policy.state_policy import forward

torch = pytest.importorskip("torch", reason="torch (extra train) is not installed")


def test_numpy_answers_as_torch_does() -> None:
    from readygo.services.trainer.reinforcement.networks import layers_of, make_network

    torch.manual_seed(0)
    network, told = make_network(7, (12, 9), 5, last_gain=0.5), np.random.default_rng(0).normal(size=(4, 7))
    told = told.astype(np.float32)
    with torch.no_grad():
        expected = network(torch.from_numpy(told)).numpy()
    assert forward(layers_of(network), told) == pytest.approx(expected, abs=1e-5)


def test_first_answers_are_small_where_the_last_gain_is() -> None:
    from readygo.services.trainer.reinforcement.networks import make_network

    answers = make_network(7, (12,), 5, last_gain=0.01)(torch.ones(3, 7))
    assert answers.abs().max() < 0.1
