import math

import numpy as np
import pytest

from readygo.common.episode.simulation import time_to_contact_s
from readygo.common.errors import SceneError
from readygo.common.messages import Outcome
from readygo.common.robot import RobotConfig

ROBOT = RobotConfig()


def _drive(simulation, v=1.0, w=0.0):
    while simulation.outcome is None:
        simulation.advance(v, w)
    return simulation.trajectory()


def test_recorded_actions_are_the_executed_commands_and_lead_from_pose_to_pose(simulate):
    simulation = simulate()
    rng = np.random.default_rng(0)
    while simulation.outcome is None:
        simulation.advance(*rng.uniform((-2, -4), (3, 4)))
    run = simulation.trajectory()
    v, w = run.actions.T
    assert v.min() >= 0
    assert v.max() <= ROBOT.v_max_mps
    assert np.abs(w).max() <= ROBOT.w_max_radps
    assert np.abs(np.diff(v, prepend=0)).max() <= ROBOT.a_max_mps2 * 0.05 + 1e-12
    assert np.abs(np.diff(w, prepend=0)).max() <= ROBOT.alpha_max_radps2 * 0.05 + 1e-12
    assert np.allclose(np.diff(run.xyyaw[:, 2]), 0.05 * w[:-1])
    assert np.allclose(np.hypot(*np.diff(run.xyyaw[:, :2], axis=0).T), 0.05 * v[:-1], atol=1e-4)


def test_executed_commands_lead_the_same_way_again_also_between_two_commands(simulate):
    robot = RobotConfig(control_hz=10, camera_hz=10)
    simulation, rng = simulate(robot=robot), np.random.default_rng(0)
    while simulation.outcome is None:
        simulation.advance(*rng.uniform((-2, -4), (3, 4)))
    first, again = simulation.trajectory(), simulate(robot=robot)
    for v, w in first.actions.tolist():
        again.hold(v, w)
        again.advance(v, w)
    assert np.array_equal(again.trajectory().actions, first.actions)
    assert again.outcome is first.outcome


def test_success_within_the_radius_of_the_goal(simulate):
    run = _drive(simulate(goal=(5.0, 0.0)))
    assert run.outcome is Outcome.SUCCESS
    last = run.xyyaw[-1, 0] + 0.05 * run.actions[-1, 0]
    assert run.xyyaw[-1, 0] < 4.0 <= last + 1e-9
    assert run.duration_s == pytest.approx(4.0 + 0.5, abs=0.1)


def test_pillar_on_the_way_is_a_static_collision(simulate):
    run = _drive(simulate(start=(0.0, 1.0, 0.0), goal=(8.0, 1.0)))
    assert run.outcome is Outcome.STATIC_COLLISION
    assert 4.0 - 0.25 - 0.05 <= run.xyyaw[-1, 0] + 0.05 * run.actions[-1, 0] < 4.0 - 0.25 + 0.05


def test_standing_human_is_hit_when_the_discs_overlap(simulate):
    run = _drive(simulate(tracks=[[(3.0, 0.0)]]))
    assert run.outcome is Outcome.HUMAN_COLLISION
    assert run.human_distance_m[-1] == pytest.approx(0.55, abs=0.06)
    assert run.human_distance_m[0] == 3.0


@pytest.mark.parametrize(
    ("human_radius_m", "aside_m", "outcome"),
    [
        (0.6, 0.84, Outcome.HUMAN_COLLISION),
        (0.6, 0.86, Outcome.SUCCESS),
        (0.1, 0.34, Outcome.HUMAN_COLLISION),
        (0.1, 0.36, Outcome.SUCCESS),
    ],
)
def test_contact_is_the_sum_of_the_robots_and_the_humans_radius(simulate, human_radius_m, aside_m, outcome):
    assert ROBOT.radius_m == 0.25
    run = _drive(simulate(tracks=[[(3.0, aside_m)]], human_radius_m=human_radius_m))
    assert run.outcome is outcome
    touched = np.any(run.time_to_collision_s == 0)
    assert not touched
    assert np.isfinite(run.time_to_collision_s).any() == (outcome is Outcome.HUMAN_COLLISION)


def test_collision_wins_over_success_in_the_same_step(simulate):
    run = _drive(simulate(goal=(5.0, 0.0), tracks=[[(4.5, 0.0)]]))
    assert run.outcome is Outcome.HUMAN_COLLISION


def test_robot_that_stands_times_out(simulate):
    run = _drive(simulate(time_limit_s=2.0), v=0.0)
    assert run.outcome is Outcome.TIMEOUT
    assert len(run.actions) == 40


def test_human_follows_its_motion_and_then_stands(simulate):
    track = np.column_stack([np.arange(10) * 0.05 + 3, np.full(10, 2.0)])
    simulation = simulate(tracks=[track])
    for _ in range(15):
        assert np.allclose(simulation.human_xy_m[0], track[min(simulation.step, 9)], atol=1e-6)
        simulation.advance(0.0, 0.0)


def test_time_to_collision_counts_down_to_the_touch(simulate):
    track = np.column_stack([6.0 - 0.05 * np.arange(200), np.zeros(200)])
    run = _drive(simulate(goal=(8.0, 0.0), tracks=[track]), v=0.0)
    assert run.outcome is Outcome.HUMAN_COLLISION
    assert run.time_to_collision_s[0] == pytest.approx(5.5, abs=1e-3)
    assert np.allclose(np.diff(run.time_to_collision_s), -0.05, atol=1e-3)
    assert _drive(simulate()).time_to_collision_s.min() == np.inf


@pytest.mark.parametrize(
    ("relative", "velocity", "expected"),
    [((3, 0), (-1, 0), 2.5), ((3, 0), (1, 0), math.inf), ((3, 2), (-1, 0), math.inf), ((0.3, 0), (1, 0), 0.0)],
)
def test_time_to_contact(relative, velocity, expected):
    assert time_to_contact_s(*relative, *velocity, 0.5) == pytest.approx(expected)


def test_start_in_an_obstacle_is_refused(simulate):
    with pytest.raises(SceneError, match="starts in an obstacle"):
        simulate(start=(3.9, 1.0, 0.0))


def test_misuse_is_refused(simulate):
    simulation = simulate(time_limit_s=0.05)
    with pytest.raises(ValueError, match="still runs"):
        simulation.trajectory()
    with pytest.raises(ValueError, match="finite"):
        simulation.advance(math.nan, 0.0)
    simulation.advance(0.0, 0.0)
    with pytest.raises(ValueError, match="has ended"):
        simulation.advance(0.0, 0.0)
    with pytest.raises(ValueError, match="human_visible"):
        simulation.trajectory(human_visible=[True, False])


@pytest.mark.parametrize(("control_hz", "camera_hz"), [(10, 30), (15, 10)])
def test_run_of_a_crooked_robot_is_that_of_a_plain_loop(simulate, control_hz, camera_hz):
    """Held commands, limits, arcs, distances and times to contact beside two who walk, one of whom stops."""
    robot = RobotConfig(
        control_hz=control_hz, camera_hz=camera_hz, radius_m=0.31, planning_radius_m=0.4, v_max_mps=0.8, v_min_mps=-0.3,
        w_max_radps=0.9, a_max_mps2=0.7, alpha_max_radps2=1.9,
    )  # fmt: skip
    k = np.arange(60)[:, None]
    tracks = [[1.0, 2.2] + [0.03, -0.02] * k, [4.4, -0.6] + [-0.02, 0.01] * k[:25]]
    simulation = simulate(
        start=(2.1, 0.7, 2.5), goal=(7.7, 3.1), tracks=tracks, robot=robot, time_limit_s=2.0, human_radius_m=0.21
    )
    rng, dt_s, held = np.random.default_rng(control_hz), robot.clock.dt_s, robot.clock.control_every
    commands = rng.uniform((-0.6, -1.5), (1.2, 1.5), (60, 2))
    x, y, yaw, v, w = 2.1, 0.7, 2.5, 0.0, 0.0
    rows, gaps_m, contacts_s = [], [], []
    for step in range(round(2.0 * robot.clock.rate_hz)):
        assert simulation.time_s == pytest.approx(step * dt_s)
        forward, left = simulation.goal_xy_robot_m
        assert np.hypot(forward, left) == pytest.approx(simulation.goal_distance_m)
        c, s = math.cos(yaw), math.sin(yaw)
        assert (x + c * forward - s * left, y + s * forward + c * left) == pytest.approx((7.7, 3.1))
        simulation.advance(*commands[step].tolist())
        wanted = np.clip(commands[step - step % held], (-0.3, -0.9), (0.8, 0.9))
        v += np.clip(wanted[0] - v, -0.7 * dt_s, 0.7 * dt_s)
        w += np.clip(wanted[1] - w, -1.9 * dt_s, 1.9 * dt_s)
        rows.append((x, y, yaw, v, w))
        humans = [np.array(track[min(step, len(track) - 1)]) for track in tracks]
        later = [np.array(track[min(step + 1, len(track) - 1)]) for track in tracks]
        gaps_m.append(min(np.hypot(*(human - (x, y))) for human in humans))
        ahead_s = np.arange(0.0, 20.0, 0.004)[:, None]
        first_s = math.inf
        for human, after in zip(humans, later, strict=True):
            closing = (after - human) / dt_s - np.array([v * math.cos(yaw), v * math.sin(yaw)])
            touches = np.hypot(*(human - (x, y) + ahead_s * closing).T) <= 0.31 + 0.21
            first_s = min(first_s, ahead_s[touches.argmax(), 0] if touches.any() else math.inf)
        contacts_s.append(first_s)
        for _ in range(40):
            yaw += 0.5 * w * dt_s / 40
            x, y = x + v * dt_s / 40 * math.cos(yaw), y + v * dt_s / 40 * math.sin(yaw)
            yaw += 0.5 * w * dt_s / 40
    assert simulation.outcome is Outcome.TIMEOUT
    run = simulation.trajectory()
    np.testing.assert_allclose(np.column_stack([run.xyyaw, run.actions]), rows, atol=1e-6)
    np.testing.assert_allclose(run.human_distance_m, gaps_m, atol=1e-5)
    finite = np.isfinite(contacts_s) & (np.array(contacts_s) < 15.0)
    np.testing.assert_allclose(run.time_to_collision_s[finite], np.array(contacts_s)[finite], atol=0.01)
    assert finite.sum() > 5
    np.testing.assert_array_equal(simulation.path_xyyaw(3, simulation.step)[:-1], run.xyyaw[3:])
    assert simulation.path_xyyaw(3, simulation.step)[-1] == pytest.approx((x, y, yaw), abs=1e-6)
    assert len(simulation.path_xyyaw(2, 5)) == 4
