import math

import numpy as np
import pytest

from readygo.common.robot import RobotConfig
from readygo.services.planner.humans.robot_task import ExpectedDrive, RobotTask, apart_m, offset_point, rotate_left

CORNER = np.array([[0.05 * k, 0.0] for k in range(61)] + [[3.0, 0.05 * k] for k in range(1, 41)])
TASK = RobotTask(start_m=(0.0, 0.0), goal_m=(3.0, 2.0), way_m=CORNER, length_m=5.0)
DRIVE = ExpectedDrive.of(RobotConfig(v_max_mps=1.0, a_max_mps2=1.0), 0.8)


def test_place_and_direction_along_the_way():
    assert TASK.at(0.0) == (pytest.approx((0.0, 0.0)), pytest.approx((1.0, 0.0)))
    assert TASK.at(0.3) == (pytest.approx((1.5, 0.0)), pytest.approx((1.0, 0.0)))
    assert TASK.at(0.6) == (pytest.approx((3.0, 0.0)), pytest.approx((math.sqrt(0.5), math.sqrt(0.5))))
    assert TASK.at(1.0) == (pytest.approx((3.0, 2.0)), pytest.approx((0.0, 1.0)))


def test_expected_drive_starts_late_by_what_speeding_up_costs():
    assert DRIVE.getting_going_s == 0.5
    assert DRIVE.time_s(4.0) == pytest.approx(4.0 / 0.8 + 0.5)
    assert DRIVE.along_m(DRIVE.time_s(3.3)) == pytest.approx(3.3)
    assert DRIVE.along_m(0.2) == 0.0


def test_expected_rows_stay_at_the_start_then_move_and_stay_at_the_goal():
    rows = DRIVE.rows(TASK, 200)
    assert rows[:11] == pytest.approx(np.zeros((11, 2)))
    assert rows[50] == pytest.approx((1.6, 0.0))
    assert rows[-1] == pytest.approx((3.0, 2.0))
    directions = DRIVE.directions(TASK, 200)
    assert directions[50] == pytest.approx((0.5, 0.0))
    assert directions[120] == pytest.approx((0.0, 0.5))


def test_left_is_left():
    assert rotate_left((1.0, 0.0), math.pi / 2) == pytest.approx((0.0, 1.0))
    assert offset_point((1.0, 1.0), (0.0, 1.0), 2.0, 0.5) == pytest.approx((0.5, 3.0))
    assert apart_m((1.0, 1.0), (4.0, 5.0)) == 5.0


def test_expected_drive_on_a_corner_is_as_it_was(golden_figures):
    drive = ExpectedDrive.of(RobotConfig(v_max_mps=0.9, a_max_mps2=0.7), 0.77)
    golden_figures("humans/expected rows", drive.rows(TASK, 190), drive.directions(TASK, 190))
    golden_figures("humans/task", [[*TASK.at(share)[0], *TASK.at(share)[1]] for share in np.linspace(0.0, 1.0, 31)])
    golden_figures(
        "humans/turned",
        [[*rotate_left((0.3, -0.8), a), *offset_point((0.2, 0.7), (0.6, 0.8), a, 0.4)] for a in (-2.5, 0.4, 1.9)],
    )
