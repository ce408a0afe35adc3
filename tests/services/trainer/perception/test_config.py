import pytest

from readygo.common.errors import ConfigError
from readygo.services.trainer.perception.config import PerceptionConfig


@pytest.mark.parametrize("wrong", [{"widths": (8, 8)}, {"samples": 0}, {"minutes": 0.0}, {"batch_size": 0}])
def test_settings_that_make_no_sense_are_refused(wrong: dict[str, object]) -> None:
    with pytest.raises((ConfigError, ValueError)):
        PerceptionConfig(**wrong)  # type: ignore[arg-type]
