import math

import numpy as np
import pytest

from readygo.common.robot import RobotConfig
from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.expert.delay import nearness_cost
from readygo.services.planner.expert.primitive_cost import CHECK_STEPS, check_reaches, find_near, human_cost
from readygo.services.planner.expert.records import HumansAhead
from readygo.services.planner.expert.timed_primitives import make_timed_primitives

ROWS = make_timed_primitives(RobotConfig()).table.rows


@pytest.mark.parametrize("seed", range(5))
def test_humans_that_are_left_out_cost_nothing(seed):
    rng = np.random.default_rng(seed)
    expected_m = rng.uniform(-4.0, 4.0, (20, 40, 2))
    humans = HumansAhead(expected_m, rng.uniform(0.1, 1.0, 20), 0.5, rng.uniform(0.1, 1.0, (20, 40)), 30.0)
    reaches = check_reaches(ROWS)
    near, counts = np.empty((len(reaches), 20), np.int32), np.zeros(len(reaches), np.int32)
    yaw, step = rng.uniform(0, 6), 10
    heading = (math.cos(yaw), math.sin(yaw))
    find_near(humans, (0.3, 0.2), step, reaches, near, counts)
    assert 0 < counts.sum() < 20 * len(reaches)
    for rows in ROWS[::17]:
        cost = 0.0
        for k in range(CHECK_STEPS - 1, len(rows), CHECK_STEPS):
            x = 0.3 + heading[0] * rows[k, 0] - heading[1] * rows[k, 1]
            y = 0.2 + heading[1] * rows[k, 0] + heading[0] * rows[k, 1]
            for m in range(20):
                squared = (expected_m[m, step + k, 0] - x) ** 2 + (expected_m[m, step + k, 1] - y) ** 2
                per_s = nearness_cost(squared, 0.5, humans.widths_m[m, step + k], 30.0)
                cost += humans.chances[m] * per_s * CHECK_STEPS * DT_S
        assert human_cost((0.3, 0.2), heading, rows, humans, step, near, counts) == pytest.approx(cost, abs=1e-12)
