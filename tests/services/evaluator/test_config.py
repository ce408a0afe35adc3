import math

import pytest

from readygo.services.evaluator import EvaluatorConfig


@pytest.mark.parametrize("wrong", [{"lockstep": 0}, {"rejected_max": 0}])
def test_counts_must_be_at_least_one(wrong):
    with pytest.raises(ValueError, match="lockstep and rejected_max must be at least 1"):
        EvaluatorConfig(**wrong)
    assert EvaluatorConfig(**dict.fromkeys(wrong, 1))


@pytest.mark.parametrize("timeout_s", [0.0, -1.0, math.nan])
def test_somebody_who_waits_must_wait_for_some_time(timeout_s):
    with pytest.raises(ValueError, match="request_timeout_s must be positive"):
        EvaluatorConfig(request_timeout_s=timeout_s)
