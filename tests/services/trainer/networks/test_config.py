import pytest

from readygo.services.trainer.networks.config import NetworkTrainConfig


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"network": "resnet"}, "network must be one of gnm, vint, nomad"),
        ({"network": "gnm", "minutes": 0.0}, "minutes"),
        ({"network": "gnm", "samples": 0}, "samples"),
        ({"network": "gnm", "learning_rate": -1.0}, "learning_rate"),
        ({"network": "gnm", "batch_size": 1}, "batch_size"),
    ],
)
def test_settings_that_make_no_sense_are_named(settings, words) -> None:
    with pytest.raises(ValueError, match=words):
        NetworkTrainConfig(**settings)
