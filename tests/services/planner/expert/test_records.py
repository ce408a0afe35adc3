import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest

from readygo.common.robot import RobotConfig
from readygo.services.planner.expert.records import HumansAhead, robot_limits, state_of


def test_state_and_limits_are_read_by_name():
    simulation = SimpleNamespace(x_m=1.0, y_m=2.0, yaw_rad=3.0, v_mps=4.0, w_radps=5.0)
    assert state_of(simulation)._asdict() == vars(simulation)
    robot = RobotConfig(v_max_mps=0.8, v_min_mps=-0.3, w_max_radps=1.1, a_max_mps2=0.6, control_hz=30, camera_hz=10)
    limits = robot_limits(robot)._asdict()
    assert limits.pop("step_s") == pytest.approx(1 / 30)
    assert (limits.pop("held_steps"), limits.pop("period_steps")) == (1, 1)
    assert robot_limits(dataclasses.replace(robot, control_hz=10)).period_steps == 2
    assert limits == {name: getattr(robot, name) for name in limits}
    assert len(set(limits.values())) == 5


def test_humans_seen_from_another_origin_move_and_nothing_else_changes():
    ahead = HumansAhead(
        expected_m=np.array([[[1.0, 2.0], [3.0, 4.0]]]),
        chances=np.ones(1),
        contact_m=0.5,
        widths_m=np.zeros((1, 2)),
        weight=2.0,
    )
    moved = ahead.seen_from(1.0, -2.0)
    assert moved.expected_m.tolist() == [[[0.0, 4.0], [2.0, 6.0]]]
    assert ahead.expected_m[0, 0].tolist() == [1.0, 2.0]
    assert all(getattr(moved, name) is getattr(ahead, name) for name in ahead._fields if name != "expected_m")
