import numpy as np
import pytest

from readygo.services.planner.expert.records import Limits, Obstacles, State, Surroundings
from readygo.services.planner.expert.rollouts import (
    FREE_RUN,
    Pursuits,
    choose_evasion,
    choose_pursuit,
    limit_command,
    meets,
    nearest_ahead,
    slow_ahead,
    try_arc,
    try_pursuit,
    turn_rate,
)

LIMITS = Limits(1.0, 1.2, 0.8, 2.0)
NOBODY = np.empty((0, 40, 2))


@pytest.fixture
def path():
    """A winding path with points at uneven distances and speeds that jump: x, y, yaw, v."""
    rng = np.random.default_rng(4)
    steps = rng.uniform(0.02, 0.2, (60, 1)) * np.column_stack([np.ones(60), rng.uniform(-0.5, 0.5, 60)])
    xy = np.cumsum(steps, axis=0)
    speed = np.where(np.arange(60) % 17 == 16, 0.1, 1.0)
    speed[-1] = 0.0
    return np.column_stack([xy, np.zeros(60), speed])


def gaps_m(path):
    return np.hypot(*np.diff(path[:, :2], axis=0).T)


@pytest.mark.parametrize("deceleration_mps2", [0.4, 0.8])
def test_braking_at_the_deceleration_reaches_every_slower_stretch_in_time(path, deceleration_mps2):
    slowed = path.copy()
    slow_ahead(slowed, deceleration_mps2)
    v = slowed[:, 3]
    assert np.all(v[:-1] ** 2 <= v[1:] ** 2 + 2 * deceleration_mps2 * gaps_m(path) + 1e-12)
    braking = v < path[:, 3]
    assert braking.sum() > 10
    tight = v[1:] ** 2 + 2 * deceleration_mps2 * gaps_m(path)
    assert v[:-1][braking[:-1]] ** 2 == pytest.approx(tight[braking[:-1]])
    assert np.all(v <= path[:, 3])
    assert np.array_equal(slowed[:, :3], path[:, :3])


def test_nearest_point_is_searched_ahead_and_not_far(path):
    assert nearest_ahead(path, 5, *path[9, :2]) == 9
    assert nearest_ahead(path, 12, *path[9, :2]) == 12
    assert nearest_ahead(path, 5, *path[40, :2]) == 20


def test_command_changes_by_what_the_robot_can_do_in_a_step():
    assert limit_command(2.0, 5.0, State(0.0, 0.0, 0.0, 0.5, 0.0), LIMITS) == pytest.approx((0.54, 0.1))
    assert limit_command(-1.0, -5.0, State(0.0, 0.0, 0.0, 0.5, 0.0), LIMITS) == pytest.approx((0.46, -0.1))
    assert limit_command(2.0, 5.0, State(0.0, 0.0, 0.0, 0.99, 1.19), LIMITS) == pytest.approx((1.0, 1.2))


@pytest.mark.parametrize("steps", [2, 5])
def test_command_that_is_held_changes_by_what_the_robot_can_do_in_all_of_its_steps(steps):
    state = State(0.0, 0.0, 0.0, 0.5, 0.0)
    assert limit_command(2.0, 5.0, state, LIMITS, steps) == pytest.approx((0.5 + 0.04 * steps, 0.1 * steps))
    assert limit_command(-1.0, -5.0, state, LIMITS, steps) == pytest.approx((0.5 - 0.04 * steps, -0.1 * steps))


def test_run_executes_each_command_as_long_as_it_is_held():
    path = np.column_stack([np.arange(0, 9, 0.05), np.zeros(180), np.zeros(180), np.ones(180)])
    state, person = State(0.0, 0.1, 0.0, 0.4, 0.0), around(standing(0.9, -0.6))
    _, gap, v, w = try_pursuit(path, 0, state, 0.5, 1.0, LIMITS._replace(held_steps=3, period_steps=5), person)
    assert (v, w) == (pytest.approx(0.4 + 3 * 0.04), pytest.approx(-3 * 0.1))
    # What follows the first command differs by how long it is held.
    others = [(1, 1), (3, 1), (3, 8)]
    gaps = [
        try_pursuit(path, 0, state, 0.5, 1.0, LIMITS._replace(held_steps=held, period_steps=period), person)[1]
        for held, period in others
    ]
    assert len({gap, *gaps}) == 4


def test_held_command_slows_down_before_a_slower_stretch():
    path = np.column_stack([np.arange(0, 3, 0.05), np.zeros(60), np.zeros(60), np.ones(60)])
    path[30:, 3] = 0.2
    state = State(1.2, 0.0, 0.0, 0.9, 0.0)
    commands = [
        try_pursuit(path, 24, state, 0.5, 1.0, LIMITS._replace(held_steps=steps), around())[2] for steps in (1, 10)
    ]
    assert commands[0] == pytest.approx(0.94)
    # After half a second at 0.6 m/s or less the robot is at the slower stretch.
    assert commands[1] == pytest.approx(0.3 / 0.45)


@pytest.mark.parametrize("held_s", [0.05, 0.5, 1.0])
def test_turn_rate_that_is_held_does_not_pass_the_heading(held_s):
    assert turn_rate(0.6, held_s) == pytest.approx(min(1.2, 0.6 / held_s))
    assert turn_rate(-0.6, held_s) == -turn_rate(0.6, held_s)


def around(humans=NOBODY, wall_x_m=None, doubt_mps=0.0):
    """An open place of 8 x 8 m from (-4, -4), with a wall from some x on."""
    occupied = np.zeros((160, 160), np.bool_)
    if wall_x_m is not None:
        occupied[:, round((wall_x_m + 4.0) / 0.05) :] = True
    columns = np.argmax(occupied[0]) - np.arange(160) if wall_x_m is not None else np.full(160, 160)
    clearance = np.tile(np.maximum(columns, 0) * 0.05, (160, 1)).astype(np.float64)
    return Surroundings(Obstacles(occupied, clearance, -4.0, -4.0, 0.05), 0.25, humans, 0.5, doubt_mps)


def standing(x, y):
    return np.full((1, 40, 2), (x, y))


def test_disc_meets_a_wall_up_to_its_radius():
    place = around(wall_x_m=1.0)
    assert meets(State(0.8, 0.0, 0.0, 0.0, 0.0), place.obstacles, 0.25)
    assert not meets(State(0.7, 0.0, 0.0, 0.0, 0.0), place.obstacles, 0.25)


def test_run_ends_at_the_wall_that_it_cannot_stop_before():
    to_goal = np.zeros((160, 160), np.int32)
    fast, slow = State(0.0, 0.0, 0.0, 1.0, 0.0), State(0.0, 0.0, 0.0, 0.0, 0.0)
    steps, _, _ = try_arc(1.0, 0.0, fast, LIMITS, around(wall_x_m=1.0), to_goal)
    assert 14 <= steps <= 16
    assert try_arc(0.0, 0.0, slow, LIMITS, around(wall_x_m=1.0), to_goal)[0] == FREE_RUN


def test_gap_is_the_least_on_the_way_and_shrinks_with_doubt():
    to_goal = np.zeros((160, 160), np.int32)
    state = State(0.0, 0.0, 0.0, 1.0, 0.0)
    sure = try_arc(1.0, 0.0, state, LIMITS, around(standing(1.0, 0.8)), to_goal)[1]
    assert sure == pytest.approx(0.3, abs=1e-3)
    unsure = try_arc(1.0, 0.0, state, LIMITS, around(standing(1.0, 0.8), doubt_mps=0.1), to_goal)[1]
    assert unsure == pytest.approx(0.2, abs=0.02)


def test_pursuit_follows_the_path_and_sees_who_stands_on_it():
    path = np.column_stack([np.arange(0, 3, 0.05), np.zeros(60), np.zeros(60), np.ones(60)])
    state = State(0.0, 0.1, 0.0, 1.0, 0.0)
    steps, gap, v, w = try_pursuit(path, 0, state, 0.5, 1.0, LIMITS, around(standing(1.5, 0.0)))
    assert steps == FREE_RUN
    assert gap < -0.3
    assert (v, w) == (pytest.approx(1.0), -0.1)
    assert try_pursuit(path, 0, state, 0.5, 0.0, LIMITS, around(standing(1.5, 0.0)))[1] > 0


def test_evasion_leaves_who_comes_nearer_and_finds_nothing_between_walls_and_speed():
    to_goal = np.zeros((160, 160), np.int32)
    coming = np.stack([1.2 - 0.06 * np.arange(40), np.full(40, -0.1)], axis=1)[None]
    state = State(0.0, 0.0, 0.0, 0.0, 0.0)
    found, v, w = choose_evasion(state, LIMITS, around(coming), 0.4, to_goal)
    assert found
    assert v > 0
    assert w > 0
    held = choose_evasion(state, LIMITS._replace(held_steps=4), around(coming), 0.4, to_goal)
    assert held == (True, pytest.approx(4 * v), pytest.approx(4 * w))
    trapped = State(0.7, 0.0, 0.0, 1.0, 0.0)
    assert not choose_evasion(trapped, LIMITS, around(coming, wall_x_m=1.0), 0.4, to_goal)[0]


def test_trials_of_commands_are_as_they_were(path, golden_figures):
    """Pursuits and evasions of a robot that reverses, before a wall, with two who walk, on a winding path."""
    limits = Limits(0.9, 1.4, 0.8, 2.6, -0.4, 1 / 30)
    k = np.arange(80)[:, None]
    walks = np.stack([[1.5, 0.9] + [-0.01, -0.015] * k, [0.9, -0.7] + [0.004, 0.012] * k])
    place, rng = around(walks, wall_x_m=2.3, doubt_mps=0.12), np.random.default_rng(2)
    to_goal = (10 * np.hypot(*np.mgrid[-90:70, -140:20])).astype(np.int32)
    pursuits = Pursuits(np.array([1.0, 0.6, 0.3, 0.0]), np.array([0.9, 0.6, 0.3]), 0.7, 0.12)
    slow_ahead(path, 0.7)
    rows = []
    for _ in range(12):
        state = State(*rng.uniform((0.0, -0.5, -0.8, -0.2, -0.6), (1.6, 0.5, 0.8, 0.8, 0.6)).tolist())
        progress = nearest_ahead(path, 0, state.x_m, state.y_m)
        run = try_pursuit(path, progress, state, 0.5, 0.8, limits, place)
        arc = try_arc(*rng.uniform((-0.4, -1.4), (0.9, 1.4)).tolist(), state, limits, place, to_goal)
        pursuit = choose_pursuit(path, progress, state, pursuits, limits, place)
        evasion = choose_evasion(state, limits, place, 0.45, to_goal)
        rows.append([progress, *run, *arc, *pursuit, *evasion])
    golden_figures("expert/trials", np.clip(np.array(rows, float), -9, 99), scale=0.7)
