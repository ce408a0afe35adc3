"""Risks of commands."""

from collections.abc import Sequence

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import EpisodeKey, EpisodeMotions, HumanMotion, HumanTrajectory, Motion, Scenario, Split
from readygo.common.robot import RobotConfig
from readygo.common.robot.command_grid import HUMAN, OBSTACLE, command_grid, mirrored
from readygo.services.driver import RiskMap

FULL_AHEAD = int(np.flatnonzero((command_grid() == (1.0, 0.0)).all(axis=1))[0])
STOP = int(np.flatnonzero((command_grid() == (0.0, 0.0)).all(axis=1))[0])


def risks_at(
    *, wall_x_m: float = 9.0, human_xy_m: Sequence[tuple[float, float]] = (), ahead_m: float = 0.0
) -> np.ndarray:
    """Risks of a robot at (2, 3) that looks along x in a room of 10 m x 6 m, after it drove `ahead_m` at full speed."""
    occupied = np.zeros((60, 100), np.bool_)
    occupied[[0, -1]] = occupied[:, [0, -1]] = True
    occupied[:, round(wall_x_m * 10)] = True
    robot_map = OccupancyMap(frame=GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.1), occupied=occupied)
    walks = np.array(human_xy_m, dtype=np.float64)
    humans = (walks,) if len(walks) else ()
    scenario = Scenario(
        episode=EpisodeKey(seed=0, split=Split.TRAIN, index=0),
        start_xyyaw=np.array([2.0, 3.0, 0.0]),
        goal_xy_m=np.array([8.0, 3.0]),
        humans=tuple(HumanTrajectory(avatar="a", encounter="crossing", speed_mps=1.0, xy_m=xy) for xy in humans),
    )
    motions = EpisodeMotions(humans=tuple(HumanMotion(avatar="a", motion=_motion(xy)) for xy in humans))
    simulation = EpisodeSimulation(scenario, motions, robot_map, RobotConfig(), EpisodeConfig())
    while simulation.x_m < 2.0 + ahead_m:
        simulation.advance(1.0, 0.0)
    return np.frombuffer(RiskMap(robot_map).risks(simulation), np.uint8)


def _motion(xy_m: np.ndarray) -> Motion:
    root_m = np.column_stack([xy_m, np.full(len(xy_m), 0.9)]).astype(np.float32)
    return Motion(root_m=root_m, pose_axis_angle=np.zeros((len(xy_m), 24, 3), np.float32))


def test_open_floor_has_no_risk():
    assert not risks_at().any()


def test_wall_ahead_is_a_risk_of_driving_on_and_none_of_stopping():
    risks = risks_at(wall_x_m=4.5, ahead_m=1.0)
    assert risks[FULL_AHEAD] == OBSTACLE
    assert risks[STOP] == 0


def test_wall_that_braking_reaches_is_a_risk_of_every_command():
    # 0.5 m to brake from full speed, and 0.35 m to the wall.
    assert (risks_at(wall_x_m=3.63, ahead_m=1.0) == OBSTACLE).all()


def test_human_who_stands_ahead_is_a_risk_of_driving_on():
    risks = risks_at(human_xy_m=[(4.3, 3.0)], ahead_m=1.0)
    assert risks[FULL_AHEAD] == HUMAN
    assert risks[STOP] == 0


@pytest.mark.parametrize(("y_then_m", "expected"), [(3.0, HUMAN), (5.5, 0)])
def test_what_counts_is_where_humans_will_be(y_then_m: float, expected: int):
    """Someone beside the way walks onto it, or away from it, within the next second."""
    walk = [(2.9, 4.2 + (y_then_m - 4.2) * min(step / 16, 1.0)) for step in range(60)]
    assert risks_at(human_xy_m=walk)[FULL_AHEAD] == expected


def test_mirrored_scene_has_mirrored_risks():
    left, right = risks_at(human_xy_m=[(2.6, 3.5)]), risks_at(human_xy_m=[(2.6, 2.5)])
    assert left.any()
    assert not left.all()
    np.testing.assert_array_equal(left, right[mirrored()])
