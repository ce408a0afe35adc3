import math
from dataclasses import dataclass
from typing import Annotated

import pytest

from readygo.common.config import Range, check_ranges


@dataclass(frozen=True)
class Section:
    share: Annotated[float, Range(low=0.0, high=1.0)] = 0.5
    speeds: Annotated[tuple[float, ...], Range(above=0.0)] = (1.0,)
    free: float = math.nan


@pytest.mark.parametrize("values", [{}, {"share": 0.0}, {"share": 1}, {"speeds": ()}, {"speeds": (0.1, 3.0)}])
def test_numbers_in_their_ranges_pass_and_fields_without_one_hold_anything(values):
    check_ranges(Section(**values))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"share": -0.1}, "share must be at least 0 and at most 1, got -0.1"),
        ({"share": 1.5}, "share must be at least 0 and at most 1, got 1.5"),
        ({"share": math.nan}, "share must be .* got nan"),
        ({"speeds": (1.0, 0.0)}, "speeds must be above 0, got 0"),
        ({"speeds": (math.inf,)}, "speeds must be above 0, got inf"),
    ],
)
def test_numbers_out_of_range_are_refused_by_field_range_and_value(values, message):
    with pytest.raises(ValueError, match=message):
        check_ranges(Section(**values))
