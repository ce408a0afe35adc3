import pytest

from readygo.services.animator import AnimatorConfig


@pytest.mark.parametrize("value", [-0.1, 1.5, float("nan")])
def test_style_variation_outside_of_its_range_is_refused(value):
    with pytest.raises(ValueError, match=r"within 0\.\.1"):
        AnimatorConfig(style_variation=value)
