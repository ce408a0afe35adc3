from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.episode import Contact
from readygo.common.messages import Outcome
from readygo.common.robot import RobotConfig
from readygo.services.evaluator.categories import Category, category_of


def ended(outcome, humans=(), path=((0.0, 0.0),)):
    """A simulation that stands at the origin at its end."""
    places = np.column_stack([np.array(path, float), np.zeros(len(path))])
    return SimpleNamespace(
        outcome=outcome,
        x_m=0.0,
        y_m=0.0,
        step=len(path) - 1,
        clock=RobotConfig().clock,
        human_xy_m=np.array(humans, float).reshape(-1, 2),
        path_xyyaw=lambda first, last: places[first : last + 1],
    )


@pytest.mark.parametrize(
    ("contact", "category"),
    [
        (Contact(robot_mps=0.5, in_view=True, seen_s=2.0), Category.SEEN_HUMAN),
        (Contact(robot_mps=0.5, in_view=True, seen_s=0.5), Category.UNSEEN_HUMAN),
        (Contact(robot_mps=0.0, in_view=True, seen_s=2.0), Category.WALKED_INTO),
    ],
)
def test_contacts_differ_by_who_moved_and_what_was_seen(contact, category):
    assert category_of(ended(Outcome.HUMAN_COLLISION), contact) is category


def test_things_are_hit_beside_a_human_or_not():
    assert category_of(ended(Outcome.STATIC_COLLISION, [(1.0, 1.0)]), None) is Category.MAKING_WAY
    assert category_of(ended(Outcome.STATIC_COLLISION, [(3.0, 0.0)]), None) is Category.THING


def test_who_is_late_stood_or_drove_on():
    standing, driving = [(0.0, 0.0)] * 300, [(k * 0.01, 0.0) for k in range(300)]
    assert category_of(ended(Outcome.TIMEOUT, path=standing), None) is Category.STUCK
    assert category_of(ended(Outcome.TIMEOUT, path=driving), None) is Category.LATE


def test_success_is_no_failure_and_a_failed_driver_is_one_whatever_came_of_it():
    assert category_of(ended(Outcome.SUCCESS), None) is None
    assert category_of(ended(Outcome.HUMAN_COLLISION), None, "it raised") is Category.DRIVER_FAILED


def far_away(outcome, *, humans=(), path=((-3.2, 7.1),), robot=RobotConfig()):  # noqa: B008
    """A simulation that ends away from the origin."""
    simulation = ended(outcome, humans, path)
    simulation.x_m, simulation.y_m = path[-1]
    simulation.clock = robot.clock
    return simulation


@pytest.mark.parametrize(
    ("human", "category"),
    [
        ((-3.2 + 1.2, 7.1 - 1.59), Category.MAKING_WAY),
        ((-3.2 + 1.2, 7.1 - 1.61), Category.THING),
        ((0.0, 0.0), Category.THING),
    ],
)
def test_human_is_beside_the_robot_within_two_metres_of_where_it_is(human, category):
    crowd = [(4.0, -9.0), human]
    assert category_of(far_away(Outcome.STATIC_COLLISION, humans=crowd), None) is category
    assert category_of(far_away(Outcome.STATIC_COLLISION), None) is Category.THING


@pytest.mark.parametrize(("moved_m", "category"), [(0.29, Category.STUCK), (-0.31, Category.LATE)])
@pytest.mark.parametrize("axis", [0, 1])
def test_who_moved_less_than_a_foot_in_the_last_ten_seconds_is_stuck(moved_m, category, axis):
    robot = RobotConfig(control_hz=10, camera_hz=15)
    path = np.tile([-3.2, 7.1], (400, 1))
    # At 30 steps a second the last ten seconds begin 300 steps before the end.
    path[:99] -= 5.0
    path[150, axis] += moved_m
    assert category_of(far_away(Outcome.TIMEOUT, path=path, robot=robot), None) is category
    path[99] -= 5.0
    assert category_of(far_away(Outcome.TIMEOUT, path=path, robot=robot), None) is Category.LATE


def test_contact_that_nobody_looked_into_has_no_category():
    assert category_of(ended(Outcome.HUMAN_COLLISION), None) is None
