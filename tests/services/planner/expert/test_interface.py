from types import SimpleNamespace

import numpy as np

from readygo.common.messages import Outcome
from readygo.services.planner.expert.interface import decisions, expected_array
from tests.services.planner.runs import perceived


class Counter:
    """A simulation that ends after three commands."""

    def __init__(self):
        self.commands = []

    @property
    def outcome(self):
        return Outcome.TIMEOUT if len(self.commands) == 3 else None

    def advance(self, v_mps, w_radps):
        self.commands.append((v_mps, w_radps))


def test_decision_is_executed_when_the_next_one_is_asked_for():
    simulation = Counter()
    expert = SimpleNamespace(act=lambda s: SimpleNamespace(v_mps=len(s.commands), w_radps=0.5))
    made = decisions(expert, simulation)
    assert next(made).v_mps == 0
    assert simulation.commands == []
    assert next(made).v_mps == 1
    assert simulation.commands == [(0, 0.5)]
    assert [decision.v_mps for decision in made] == [2]
    assert len(simulation.commands) == 3


def test_episode_that_has_ended_asks_for_nothing():
    simulation = Counter()
    simulation.commands = [None] * 3
    assert list(decisions(SimpleNamespace(act=None), simulation)) == []


def test_humans_are_rows_of_what_is_ahead_of_them():
    expected = expected_array([perceived(1.0, 2.0), perceived(-3.0, 0.0)], 5)
    assert expected.shape == (2, 5, 2)
    assert np.array_equal(expected[1], perceived(-3.0, 0.0).ahead_m[:5])
    assert expected[:, :, 0].tolist() == [[1.0] * 5, [-3.0] * 5]
    assert expected_array([], 5).shape == (0, 5, 2)
