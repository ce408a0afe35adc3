import pytest

from readygo.services.trainer import TrainConfig


@pytest.mark.parametrize(
    "wrong", [{"minutes": 0.0}, {"epochs": 0}, {"batch_size": 0}, {"ema_decay": 1.0}, {"learning_rate": 0.0}]
)
def test_settings_that_make_no_sense_are_refused(wrong):
    with pytest.raises(ValueError, match=next(iter(wrong))):
        TrainConfig(**wrong)
