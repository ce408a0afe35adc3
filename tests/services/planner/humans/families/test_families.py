import itertools

import numpy as np
import pytest

from readygo.common.episode import meets_obstacle
from readygo.services.planner.humans.families import FAMILIES
from tests.services.planner.worlds import rooms


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_finds_room_in_a_flat_and_says_its_name(drawn, family):
    assert len(drawn[family]) >= 3
    for scenario, _ in drawn[family]:
        assert {human.encounter for human in scenario.humans} == {family}


@pytest.mark.parametrize("family", FAMILIES)
def test_nobody_touches_a_wall_runs_or_creeps(drawn, family):
    occupancy = rooms()
    for human in itertools.chain.from_iterable(scenario.humans for scenario, _ in drawn[family]):
        assert not any(meets_obstacle(occupancy, x, y, 0.25) for x, y in human.xy_m.tolist())
        assert 0.5 <= human.speed_mps <= 2.0
        assert np.hypot(*np.diff(human.xy_m, axis=0).T).max() <= 0.05 * human.speed_mps + 1e-6
