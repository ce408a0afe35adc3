from typing import Any

import pytest

from readygo.services.reconstructor.config import FramesConfig, MetricConfig, PosesConfig


@pytest.mark.parametrize(
    ("section", "values"),
    [(FramesConfig, {"count_max": 2}), (PosesConfig, {"registered_min": 1.5}), (MetricConfig, {"marker_size_m": -0.2})],
)
def test_numbers_out_of_range_are_refused(section: type, values: dict[str, Any]) -> None:
    with pytest.raises(ValueError, match=next(iter(values))):
        section(**values)
