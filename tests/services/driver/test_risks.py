"""Risks of commands."""

import math
from collections.abc import Sequence

import numpy as np
import pytest

from readygo.common.episode import EpisodeConfig, EpisodeSimulation
from readygo.common.maps import GridFrame, OccupancyMap
from readygo.common.messages import EpisodeKey, EpisodeMotions, HumanMotion, HumanTrajectory, Scenario, Split
from readygo.common.robot import RobotConfig, limit_command, step_unicycle
from readygo.common.robot.command_grid import HUMAN, OBSTACLE, command_grid, mirror_indices
from readygo.services.driver import RiskMap
from readygo.services.driver.risks import HOLD_S, HORIZON_S, HUMAN_MARGIN_M, OBSTACLE_MARGIN_M
from tests.common.episode.upright import upright_motion

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
    walks = [np.array(human_xy_m)] if human_xy_m else []
    simulation = _simulation(robot_map, RobotConfig(), (2.0, 3.0, 0.0), walks)
    while simulation.x_m < 2.0 + ahead_m:
        simulation.advance(1.0, 0.0)
    return np.frombuffer(RiskMap(robot_map).risks(simulation), np.uint8)


def _simulation(
    robot_map: OccupancyMap, robot: RobotConfig, start_xyyaw: tuple[float, float, float], walks: Sequence[np.ndarray]
) -> EpisodeSimulation:
    scenario = Scenario(
        episode=EpisodeKey(seed=0, split=Split.TRAIN, index=0),
        start_xyyaw=np.array(start_xyyaw),
        goal_xy_m=np.array([8.0, 3.0]),
        humans=tuple(HumanTrajectory(avatar="a", encounter="crossing", speed_mps=1.0, xy_m=xy) for xy in walks),
    )
    motions = EpisodeMotions(humans=tuple(HumanMotion(avatar="a", motion=upright_motion(xy)) for xy in walks))
    return EpisodeSimulation(scenario, motions, robot_map, robot, EpisodeConfig(human_radius_m=0.3))


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
    np.testing.assert_array_equal(left, right[mirror_indices()])


@pytest.mark.parametrize(("control_hz", "camera_hz"), [(10, 20), (25, 25), (10, 30)])
def test_risks_are_those_of_rolling_out_each_command_against_every_cell_and_human(control_hz: int, camera_hz: int):
    """A robot that reverses, turned by 2.5 rad and in motion, between pillars and three who walk."""
    robot = RobotConfig(
        control_hz=control_hz, camera_hz=camera_hz, radius_m=0.31, planning_radius_m=0.4, v_max_mps=1.3, v_min_mps=-0.7,
        w_max_radps=1.7, a_max_mps2=1.6, alpha_max_radps2=3.1,
    )  # fmt: skip
    rng = np.random.default_rng(control_hz + camera_hz)
    occupied = rng.random((47, 71)) < 0.004
    frame = GridFrame(origin_x_m=-3.1, origin_y_m=5.3, resolution_m=0.13)
    robot_map = OccupancyMap(frame=frame, occupied=occupied)
    weigher, seen, decided = RiskMap(robot_map), set(), 0
    for _ in range(4):
        starts = rng.uniform((-2.0, 6.5), (5.0, 10.3), (3, 2))
        rates = rng.uniform(-1.5, 1.5, (3, 2)) / robot.clock.rate_hz
        walks = [start + rate * np.arange(200)[:, None] for start, rate in zip(starts, rates, strict=True)]
        free_xy = next(xy for xy in rng.uniform((-1.5, 6.5), (4.5, 10.0), (500, 2)) if _is_free(robot_map, walks, xy))
        simulation = _simulation(robot_map, robot, (*free_xy.tolist(), 2.5), walks)
        for _ in range(int(rng.integers(4, 9))):
            if simulation.outcome is None:
                simulation.advance(*rng.uniform((-1.0, -2.0), (1.5, 2.0)).tolist())
        risks = np.frombuffer(weigher.risks(simulation), np.uint8)
        gaps_m = _gaps_m(simulation)
        sure = _risks_of(gaps_m - 2e-3) == _risks_of(gaps_m + 2e-3)
        np.testing.assert_array_equal(risks[sure], _risks_of(gaps_m)[sure])
        seen |= {*risks.tolist()}
        decided += int(np.count_nonzero(sure))
    assert seen == {0, OBSTACLE, HUMAN}
    assert decided > 0.94 * 4 * len(command_grid(robot))


def _is_free(robot_map: OccupancyMap, walks: Sequence[np.ndarray], xy: np.ndarray) -> bool:
    return _gap_m(robot_map, *xy) > 0.45 and min(np.hypot(*(walk[0] - xy)) for walk in walks) > 0.9


def _gap_m(robot_map: OccupancyMap, x: float, y: float) -> float:
    """Distance of a point to the nearest occupied square or to the border [m]."""
    frame, (rows, columns) = robot_map.frame, np.nonzero(robot_map.occupied)
    low_x = frame.origin_x_m + columns * frame.resolution_m
    low_y = frame.origin_y_m + rows * frame.resolution_m
    dx = np.maximum(np.maximum(low_x - x, x - low_x - frame.resolution_m), 0.0)
    dy = np.maximum(np.maximum(low_y - y, y - low_y - frame.resolution_m), 0.0)
    height, width = robot_map.occupied.shape
    from_left, from_bottom = x - frame.origin_x_m, y - frame.origin_y_m
    sides = (from_left, width * frame.resolution_m - from_left, from_bottom, height * frame.resolution_m - from_bottom)
    return min(float(np.hypot(dx, dy).min()), *sides)


def _gaps_m(simulation: EpisodeSimulation) -> np.ndarray:
    """Free space along the exact arcs of all commands, to obstacles and to humans [m], shape (C, T, 2)."""
    robot, clock = simulation.robot, simulation.clock
    stride = round(0.1 * clock.rate_hz)
    dt_s = stride / clock.rate_hz
    touch_m = (robot.radius_m + OBSTACLE_MARGIN_M, robot.radius_m + simulation.config.human_radius_m + HUMAN_MARGIN_M)
    gaps_m = np.empty((len(command_grid(robot)), round(HORIZON_S / dt_s), 2))
    for command, (share_v, share_w) in enumerate(command_grid(robot).tolist()):
        x, y, yaw, v, w = simulation.x_m, simulation.y_m, simulation.yaw_rad, simulation.v_mps, simulation.w_radps
        for k in range(gaps_m.shape[1]):
            wanted = (share_v * robot.v_max_mps, share_w * robot.w_max_radps) if k * dt_s < HOLD_S - 1e-9 else (0, 0)
            v, w = limit_command(*wanted, v, w, robot, dt_s)
            x, y, yaw = step_unicycle(x, y, yaw, v, w, dt_s)
            humans_m = simulation.human_xy_at(simulation.step + stride * (k + 1)).tolist()
            nearest_m = min(math.hypot(human_x - x, human_y - y) for human_x, human_y in humans_m)
            gaps_m[command, k] = _gap_m(simulation.robot_map, x, y) - touch_m[0], nearest_m - touch_m[1]
    return gaps_m


def _risks_of(gaps_m: np.ndarray) -> np.ndarray:
    """What each command meets first; an obstacle where it meets both in one step."""
    meets = gaps_m < 0
    first = meets.any(axis=2).argmax(axis=1)
    obstacle, human = meets[np.arange(len(gaps_m)), first].T
    return np.where(obstacle, OBSTACLE, np.where(human, HUMAN, 0)).astype(np.uint8)
