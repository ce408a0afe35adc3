"""Drawn plans: rooms side by side, each of which can be reached through doorways."""

import itertools

import numpy as np
import pytest

from readygo.common.scenes.embedded.drawn_plan import DEPTH_M, DOOR_M, HALL_M, ROOM_MIN_M, WIDTH_M, draw_plan
from readygo.common.scenes.embedded.plan import FloorPlan, Opening, Room

PLANS = [draw_plan(np.random.default_rng(seed)) for seed in range(40)]
plans = pytest.mark.parametrize("plan", PLANS, ids=str)


def sides_m(room: Room) -> tuple[float, float]:
    return room.x_m[1] - room.x_m[0], room.y_m[1] - room.y_m[0]


def is_hall(room: Room) -> bool:
    return room.name.startswith("hall")


def rooms_at(plan: FloorPlan, door: Opening) -> list[int]:
    """The rooms on both sides of a doorway, which it touches along its whole width."""
    wall = plan.walls[door.wall]
    found = []
    for k, room in enumerate(plan.rooms):
        across, along = (room.x_m, room.y_m) if wall.axis == "x" else (room.y_m, room.x_m)
        touches = wall.low_m in across or wall.high_m in across
        if touches and along[0] < door.begin_m and door.end_m < along[1]:
            found.append(k)
    return found


@plans
def test_rooms_do_not_overlap_and_fill_the_flat_but_for_the_walls(plan: FloorPlan) -> None:
    for one, other in itertools.combinations(plan.rooms, 2):
        across = min(one.x_m[1], other.x_m[1]) - max(one.x_m[0], other.x_m[0])
        along = min(one.y_m[1], other.y_m[1]) - max(one.y_m[0], other.y_m[0])
        assert min(across, along) < 0.0
    inner = [wall for name, wall in plan.walls.items() if name.startswith("inner")]
    taken = sum(np.prod(sides_m(room)) for room in plan.rooms)
    taken += sum((wall.high_m - wall.low_m) * (wall.end_m - wall.begin_m) for wall in inner)
    whole = np.subtract(plan.high_m, plan.low_m)
    assert taken == pytest.approx(whole.prod(), abs=1e-6)
    assert WIDTH_M[0] - 0.01 <= whole[0] <= WIDTH_M[1] + 0.01
    assert DEPTH_M[0] - 0.01 <= whole[1] <= DEPTH_M[1] + 0.01


@plans
def test_rooms_are_large_enough_and_halls_narrow(plan: FloorPlan) -> None:
    for room in plan.rooms:
        if is_hall(room):
            assert HALL_M[0] - 0.01 <= min(sides_m(room)) <= HALL_M[1] + 0.01
        else:
            assert min(sides_m(room)) >= ROOM_MIN_M - 0.011


@plans
def test_every_room_is_reached(plan: FloorPlan) -> None:
    doors = [rooms_at(plan, opening) for opening in plan.openings if not opening.is_window]
    assert all(len(pair) == 2 for pair in doors)
    reached = {0}
    for _ in plan.rooms:
        reached |= {room for pair in doors if set(pair) & reached for room in pair}
    assert reached == set(range(len(plan.rooms)))


@plans
def test_openings_lie_in_their_walls_side_by_side(plan: FloorPlan) -> None:
    assert {opening.wall for opening in plan.openings} <= set(plan.walls)
    for name, wall in plan.walls.items():
        edges = [edge for opening in plan.openings_of(name) for edge in (opening.begin_m, opening.end_m)]
        assert edges == sorted(edges)
        assert all(wall.begin_m < edge < wall.end_m for edge in edges)
    for opening in plan.openings:
        assert opening.is_window == (opening.wall in ("west", "east", "south", "north"))
        if not opening.is_window:
            assert opening.end_m - opening.begin_m >= DOOR_M[0] - 0.011


@plans
def test_walls_of_a_room_are_at_its_sides(plan: FloorPlan) -> None:
    for room in plan.rooms:
        (x0, x1), (y0, y1) = room.x_m, room.y_m
        assert plan.walls[room.walls["west"]].high_m == x0
        assert plan.walls[room.walls["east"]].low_m == x1
        assert plan.walls[room.walls["south"]].high_m == y0
        assert plan.walls[room.walls["north"]].low_m == y1


@plans
def test_every_room_has_a_lamp(plan: FloorPlan) -> None:
    for room in plan.rooms:
        assert any(room.x_m[0] < x < room.x_m[1] and room.y_m[0] < y < room.y_m[1] for x, y, _ in plan.lamps_m)


def test_plans_differ() -> None:
    assert {len(plan.rooms) for plan in PLANS} >= {4, 5, 6, 7}
    assert len({plan.high_m for plan in PLANS}) == len(PLANS)
    halls = sum(any(is_hall(room) for room in plan.rooms) for plan in PLANS)
    assert 15 <= halls <= 33
    assert {room.floor for plan in PLANS for room in plan.rooms} == {"oak", "walnut", "tiles", "carpet"}
    finishes = {cover.finish for plan in PLANS for room in plan.rooms for cover in room.coverings.values()}
    assert len(finishes) == 3
    assert any(sum(not opening.is_window for opening in plan.openings) >= len(plan.rooms) for plan in PLANS)


def test_same_seed_draws_the_same_plan() -> None:
    assert draw_plan(np.random.default_rng(7)) == PLANS[7]
