import itertools
import math

import numpy as np
import pytest

from readygo.common.robot.kinematics import DT_S
from readygo.services.planner.humans.velocity_choice import Cells, Sight, Wish, next_place, next_row

NOBODY = np.empty((0, 5))
ALL_ROUND = Sight(cos_half_cone=-1.0, range_m=5.0)


def cells(wall_x_m=None):
    """An open place of 8 x 8 m from (-4, -4), with a wall from some x on."""
    occupied = np.zeros((160, 160), np.bool_)
    if wall_x_m is not None:
        occupied[:, round((wall_x_m + 4.0) / 0.05) :] = True
    return Cells(occupied, np.where(occupied, np.uint8(0), np.uint8(1)), -4.0, -4.0, 0.05)


def walking(speed=1.0, target=(3.0, 0.0)):
    """At the origin, along +x."""
    return Wish(np.zeros(2), np.array([speed, 0.0]), np.array([1.0, 0.0]), np.array(target), speed)


def step(wish, discs=NOBODY, sight=ALL_ROUND, place=None):
    return next_place(wish, np.array(discs, float).reshape(-1, 5), sight, place or cells(), 0.25)


def test_alone_the_wanted_velocity_is_taken():
    assert step(walking()) == pytest.approx((DT_S, 0.0))


@pytest.mark.parametrize("side", [1, -1])
def test_who_comes_head_on_is_passed_on_the_freer_side(side):
    assert side * step(walking(), [(2.0, -0.1 * side, -1.0, 0.0, 0.5)])[1] > 0


def test_speed_changes_by_the_acceleration_at_most():
    moved = step(walking(1.2), [(2.0, 0.1, -1.0, 0.0, 0.5)])
    change = moved / DT_S - (1.2, 0.0)
    assert 0 < math.hypot(*change) <= 2.0 * DT_S + 1e-9


@pytest.mark.parametrize(("bearing_deg", "reacts"), [(0, True), (80, True), (100, False), (150, False)])
def test_only_who_is_within_the_cone_is_avoided(bearing_deg, reacts):
    half = Sight(cos_half_cone=math.cos(math.radians(90)), range_m=5.0)
    c, s = math.cos(math.radians(bearing_deg)), math.sin(math.radians(bearing_deg))
    # Comes straight at the place where the walker will be in a second.
    coming = [(1.5 * c, 1.5 * s, 1.0 - 1.5 * c, -1.5 * s, 0.5)]
    assert np.array_equal(step(walking(), coming, half), step(walking())) is not reacts
    assert not np.array_equal(step(walking(), coming), step(walking()))


def test_who_is_beyond_the_range_or_behind_a_wall_is_not_there():
    coming = [(2.0, 0.1, -1.0, 0.0, 0.5)]
    assert np.array_equal(step(walking(), coming, Sight(cos_half_cone=-1.0, range_m=1.9)), step(walking()))
    far = walking(0.5, target=(0.5, 0.0))
    assert np.array_equal(step(far, coming, place=cells(1.2)), step(far, place=cells(1.2)))
    assert not np.array_equal(step(far, coming), step(far))


def test_nobody_walks_into_a_wall():
    stopped = walking(1.0)
    place = cells(0.3)
    assert step(stopped, place=place) == pytest.approx((0.0, 0.0))


def test_row_waits_for_who_is_late_and_skips_ahead_for_who_is_early():
    rows = np.array([[0.1 * k, 0.0] for k in range(20)])
    assert next_row(rows, 5, np.array([0.4, 0.0])) == 6
    assert next_row(rows, 5, np.array([0.5, 0.5])) == 5
    assert next_row(rows, 5, np.array([1.2, 0.0])) == 12
    assert next_row(rows, 19, np.array([1.9, 0.0])) == 19


def test_step_is_towards_the_cheapest_velocity_of_the_fan():
    """Written from the definition: times of contact by roots, walls as squares, velocities one by one."""
    rng = np.random.default_rng(8)
    shares, turns = (1.0, 0.75, 0.5, 0.25, 0.0), np.radians([0, 15, -15, 30, -30, 50, -50, 75, -75])
    compared, near, blocked = 0, 0, 0
    for trial in range(30):
        here, velocity = rng.uniform(-0.4, 0.4, 2), rng.normal(0.0, 0.8, 2)
        speed, target = rng.uniform(0.3, 1.5), rng.uniform(-3, 3, 2)
        discs = np.column_stack([rng.uniform(-1.8, 1.8, (3, 2)), rng.normal(0, 0.7, (3, 2)), rng.uniform(0.3, 0.6, 3)])
        if trial % 3 == 0:
            discs[0, :2] = here + rng.uniform(-0.5, 0.5, 2)
        walled = trial % 2 == 1
        place = cells(1.0) if walled else cells()
        if walled:
            here[0] += 0.3
            discs[:, 0] = np.minimum(discs[:, 0], 0.9)
        along = (target - here) / np.hypot(*(target - here))
        options = []
        for turn, share in itertools.product(turns, shares):
            c, s = math.cos(turn), math.sin(turn)
            way = np.array([c * along[0] - s * along[1], s * along[0] + c * along[1]])
            u = share * (speed if turn == 0 else max(speed, 0.6)) * way
            reach_x = max((here + 0.15 * k * u)[0] for k in range(1, 5)) + 0.25 + 0.06
            if walled and share > 0 and reach_x >= 1.0:
                blocked += 1
                continue
            options.append((_objective(u, here, velocity, speed * along, discs), u))
        options.sort(key=lambda option: option[0])
        if options[1][0] - options[0][0] < 1e-6 and not np.allclose(options[0][1], options[1][1]):
            continue
        near += bool((np.hypot(*(discs[:, :2] - here).T) <= discs[:, 4] + 0.3).any())
        change = options[0][1] - velocity
        change *= min(1.0, 2.0 * DT_S / np.hypot(*change))
        moved = here + (velocity + change) * DT_S
        if walled and moved[0] + 0.28 >= 1.0:
            moved = here
        wish = Wish(here, velocity, along, target, speed)
        assert step(wish, discs, place=place) == pytest.approx(moved, abs=1e-9)
        compared += 1
    assert compared > 25
    assert near > 8
    assert blocked > 8


def _objective(u, here, velocity, wanted, discs):
    cost = math.dist(u, wanted) + 0.15 * math.dist(u, velocity)
    for x, y, vx, vy, touch_m in discs.tolist():
        away, closing = np.array([x, y]) - here, np.array([vx, vy]) - u
        distance, room_m = np.hypot(*away), touch_m + 0.3
        if distance <= room_m:
            cost += 2.0 * max(0.0, -(away @ closing) / distance)
            continue
        times = np.roots([closing @ closing, 2 * away @ closing, away @ away - room_m**2])
        times = times[(abs(times.imag) < 1e-12) & (times.real > 0)].real
        if len(times) and times.min() < 3.0:
            cost += 2.0 * (1.0 - times.min() / 3.0)
    return cost


def test_row_is_the_next_one_up_to_the_limit_of_who_is_behind():
    rows = np.array([[0.1 * k, 0.0] for k in range(20)])
    for aside_m, row in ((0.34, 6), (0.36, 5)):
        assert next_row(rows, 5, np.array([0.5, aside_m])) == row
    assert next_row(rows, 17, np.array([9.0, 0.0])) == 19
