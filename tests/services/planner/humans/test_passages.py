import math

import numpy as np
import pytest

from readygo.services.planner.humans.passages import find_passages
from tests.services.planner.worlds import DOORS, FRAME, planner_of


def test_passages_of_a_flat_are_its_doors():
    planner = planner_of("doorway")
    passages = planner.sampler.site.passages
    wide = [passage for passage in passages if passage.width_m > 1.1]
    assert len(wide) >= len(DOORS)
    for door in DOORS:
        nearest = min(passages, key=lambda passage: math.dist(passage.middle_m, door))
        assert math.dist(nearest.middle_m, door) < 0.15
        assert nearest.width_m == pytest.approx(1.2, abs=0.06)


def test_an_empty_hall_has_no_passages():
    clearance = np.minimum.outer(np.r_[0:50, 50:0:-1], np.r_[0:80, 80:0:-1]) * 0.05
    assert find_passages(clearance, FRAME, walkable_m=0.375, width_max_m=1.6, wider_m=0.5) == ()


def test_passages_are_as_they_were(golden_figures):
    found = sorted(planner_of("doorway").sampler.site.passages, key=lambda passage: passage.middle_m)
    golden_figures("humans/passages", [[*passage.middle_m, passage.width_m] for passage in found])
