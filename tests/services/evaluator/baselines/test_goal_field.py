import math

import pytest

from readygo.services.evaluator.baselines.goal_field import GoalField
from tests.services.evaluator.conftest import hall

BEHIND_WALL = (10.0, 1.0)


def test_distance_goes_around_the_wall():
    field = GoalField(hall(), 0.3, BEHIND_WALL)
    assert field.distance_m(10.0, 4.0) == pytest.approx(3.0, abs=0.2)
    around = math.hypot(7.0, 2.3) + math.hypot(2.0, 2.3)
    assert field.distance_m(1.0, 1.0) == pytest.approx(around, rel=0.08)
    assert GoalField(hall(), 3.0, BEHIND_WALL).distance_m(1.0, 1.0) == math.inf


def test_point_ahead_is_in_sight_and_nearer_to_the_goal():
    field = GoalField(hall(), 0.3, BEHIND_WALL)
    x, y = field.ahead(7.0, 1.0, 1.0)
    assert y > 1.5, "up, to the end of the wall"
    assert field.distance_m(x, y) < field.distance_m(7.0, 1.0) - 0.6
    assert field.ahead(9.9, 1.05, 1.0) == BEHIND_WALL


def test_goal_itself_is_ahead_where_no_way_leads_to_it():
    assert GoalField(hall(), 3.0, BEHIND_WALL).ahead(1.0, 1.0, 1.0) == BEHIND_WALL
