import numpy as np
import pytest

from readygo.common.messages import Outcome
from readygo.services.evaluator.baselines.discrete import FORWARD_M, TURN_RAD, DiscretePlannerDriver
from tests.services.evaluator.baselines.driving import drive
from tests.services.evaluator.conftest import hall


def stops(path):
    """Poses at which the robot stood, one per stop."""
    still = np.flatnonzero(np.abs(np.diff(path, axis=0)).max(axis=1) < 1e-3)
    return path[still[np.diff(still, prepend=-9) > 1]]


def test_goal_behind_a_wall_is_reached():
    simulation, _ = drive(DiscretePlannerDriver(), (1.0, 1.0, 0.0), (10.0, 1.0))
    assert simulation.outcome is Outcome.SUCCESS


def test_robot_goes_quarter_metres_or_turns_by_thirty_degrees_and_stands_between():
    _, path = drive(DiscretePlannerDriver(), (1.0, 4.0, 2.0), (6.0, 5.0))
    places = stops(path)
    moved, turned = np.hypot(*np.diff(places[:, :2], axis=0).T), np.abs(np.diff(places[:, 2]))
    assert len(moved) >= 3
    for metres, radians in zip(moved, turned, strict=True):
        straight = metres / FORWARD_M == pytest.approx(round(metres / FORWARD_M), abs=0.25) and radians < 0.03
        assert straight or (radians == pytest.approx(TURN_RAD, abs=0.06) and metres < 0.03)


def test_step_for_which_there_is_no_room_is_not_taken():
    # A gap of 0.8 m for a robot of 0.6 m, met at a slant that no turn makes straight.
    room = hall()
    room.occupied[:, 50] = True
    room.occupied[26:34, 50] = False
    for y_m in (1.2, 2.3, 3.4):
        simulation, _ = drive(DiscretePlannerDriver(), (2.0, y_m, 2.8), (7.0, 4.4), occupancy=room)
        assert simulation.outcome is Outcome.SUCCESS
