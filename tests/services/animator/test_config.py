import pytest

from readygo.common.config import section_to_mapping
from readygo.services.animator import AnimatorConfig


@pytest.mark.parametrize("value", [-0.1, 1.5, float("nan")])
def test_style_variation_outside_of_its_range_is_refused(value):
    with pytest.raises(ValueError, match=r"within 0\.\.1"):
        AnimatorConfig(style_variation=value)


def test_defaults_are_those_of_the_runs_that_name_none() -> None:
    assert section_to_mapping(AnimatorConfig()) == {
        "source": "gait",
        "style_variation": 1.0,
        "priormdm": {
            "weights": "",
            "mean": "",
            "std": "",
            "text_embedding": "",
            "sampler": "ddpm",
            "steps": 0,
            "refine": "none",
            "pose_prior": "",
            "device": "cpu",
            "sha256": "",
        },
    }
