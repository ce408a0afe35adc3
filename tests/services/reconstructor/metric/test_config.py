import pytest

from readygo.services.reconstructor.metric.config import MetricConfig


def test_numbers_out_of_range_are_refused() -> None:
    with pytest.raises(ValueError, match="marker_size_m"):
        MetricConfig(marker_size_m=-0.2)
