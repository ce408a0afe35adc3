import math

import pytest

from readygo.services.planner import FamilyMix


@pytest.mark.parametrize("shares", [{"crossing": -1.0}, {"frontal": math.nan}, {}])
def test_mixes_that_cannot_be_drawn_are_refused(shares):
    with pytest.raises(ValueError, match=r"must be a number|share above 0"):
        FamilyMix(**shares)
