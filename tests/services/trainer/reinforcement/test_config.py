import pytest

from readygo.services.trainer.reinforcement.config import PpoConfig, ReinforcementConfig


def test_what_is_out_of_range_is_refused() -> None:
    with pytest.raises(ValueError, match="gamma"):
        PpoConfig(gamma=1.5)
    with pytest.raises(ValueError, match="static_share"):
        ReinforcementConfig(static_share=-0.1)
