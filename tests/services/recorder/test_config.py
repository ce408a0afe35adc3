import math

import pytest

from readygo.services.recorder import RecorderConfig


@pytest.mark.parametrize("name", ["episodes_per_shard", "buffer_mib"])
@pytest.mark.parametrize("value", [0, -1, math.nan])
def test_settings_that_must_be_positive_are_refused_by_name(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"^{name} must be positive, got {value}\.$"):
        RecorderConfig(**{name: value})
    assert getattr(RecorderConfig(**{name: 1}), name) == 1
