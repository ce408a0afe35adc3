import dataclasses

import pytest

from readygo.common.messages.evaluation import EvaluationPlan
from tests.common.messages.examples import SHA256, message


@pytest.mark.parametrize("sha256", ["", "a", "/etc/passwd", SHA256.upper()])
def test_method_is_known_by_a_hash(sha256: str) -> None:
    plan = message(EvaluationPlan)
    assert dataclasses.replace(plan, method_hashes={"gnm": SHA256}).method_hashes == {"gnm": SHA256}
    with pytest.raises(ValueError, match="method_hashes of 'gnm' must be 64 hexadecimal digits"):
        dataclasses.replace(plan, method_hashes={"gnm": sha256})
