import pytest

from readygo.services.reconstructor.frames.config import FramesConfig


def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="count_max"):
        FramesConfig(count_max=2)
