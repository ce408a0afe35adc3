import pytest

from readygo.services.evaluator.drivers import StraightLineDriver, short_name
from tests.services.evaluator.baselines.driving import drive


def test_straight_line_turns_to_the_goal_and_arrives():
    simulation, poses = drive(StraightLineDriver(), (1.0, 1.0, 2.0), (4.0, 1.0))
    assert simulation.outcome.value == "success"
    assert poses[:, 0].min() > 0.9
    assert poses[-1, 1] == pytest.approx(1.0, abs=0.2)


def test_users_own_method_is_called_by_its_class():
    assert short_name("my_package.drivers:MyDriver") == "MyDriver"
    assert short_name("policy") == "policy"
