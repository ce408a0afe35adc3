import pytest

from readygo.services.evaluator import EvaluatorConfig


def test_episodes_in_lockstep_must_be_at_least_one():
    with pytest.raises(ValueError, match="lockstep must be at least 1, got 0"):
        EvaluatorConfig(lockstep=0)
    assert EvaluatorConfig(lockstep=1).lockstep == 1
