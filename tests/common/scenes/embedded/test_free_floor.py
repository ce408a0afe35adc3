"""A robot gets everywhere in a flat, and furniture is refused that would change this."""

import numpy as np
import pytest

from readygo.common.scenes.embedded.free_floor import FreeFloor
from readygo.common.scenes.embedded.plan import FloorPlan, Wall


def hall_of(width_m: float, depth_m: float) -> FloorPlan:
    x, y = width_m / 2, depth_m / 2
    return FloorPlan(
        walls={
            "west": Wall(axis="x", low_m=-x - 0.2, high_m=-x, begin_m=-y, end_m=y),
            "east": Wall(axis="x", low_m=x, high_m=x + 0.2, begin_m=-y, end_m=y),
            "south": Wall(axis="y", low_m=-y - 0.2, high_m=-y, begin_m=-x, end_m=x),
            "north": Wall(axis="y", low_m=y, high_m=y + 0.2, begin_m=-x, end_m=x),
        },
        openings=(),
        rooms=(),
        lamps_m=(),
    )


@pytest.fixture
def floor() -> FreeFloor:
    """Six by two metres; the walls leave 5.3 by 1.3 m for a robot's middle."""
    x, y = np.linspace(-2.99, 2.99, 241), np.linspace(-0.99, 0.99, 81)
    sides = [np.column_stack([x, np.full(241, side), np.ones(241)]) for side in (-0.99, 0.99)]
    ends = [np.column_stack([np.full(81, end), y, np.ones(81)]) for end in (-2.99, 2.99)]
    walls = np.concatenate([*sides, *ends])
    return FreeFloor(hall_of(6.0, 2.0), walls)


def test_area_is_where_the_middle_of_a_robot_may_be(floor: FreeFloor) -> None:
    assert floor.area_m2 == pytest.approx(5.3 * 1.3, abs=0.4)


def test_what_lies_on_the_floor_or_hangs_high_is_not_in_the_way() -> None:
    plan, corner = hall_of(6.0, 2.0), [[-2.99, -0.99, 1.0]]
    rug_and_lamp = [[x, 0.0, z] for x in (0.0, 0.5) for z in (0.01, 2.3)]
    assert FreeFloor(plan, np.array(corner + rug_and_lamp)).area_m2 == FreeFloor(plan, np.array(corner)).area_m2
    assert FreeFloor(plan, np.array([*corner, [0.0, 0.0, 0.5]])).area_m2 < FreeFloor(plan, np.array(corner)).area_m2


def test_piece_that_would_divide_the_floor_is_refused(floor: FreeFloor) -> None:
    before = floor.area_m2
    assert not floor.take_disc(0.0, 0.0, 0.4)
    assert not floor.take_box((-0.2, -1.0), (0.2, 0.5))
    assert floor.area_m2 == before


def test_piece_at_a_wall_is_taken_and_leaves_less_for_the_next(floor: FreeFloor) -> None:
    before = floor.area_m2
    assert floor.take_box((-0.4, -1.0), (0.4, -0.6))
    assert floor.area_m2 < before - 0.3
    # What would have left a way before now ends it.
    assert not floor.take_box((-0.4, 0.1), (0.4, 1.0))
    assert floor.take_box((1.6, 0.4), (2.4, 1.0))


def test_disc_on_what_stands_there_is_refused(floor: FreeFloor) -> None:
    assert floor.take_disc(2.6, 0.6, 0.3)
    assert not floor.take_disc(2.5, 0.5, 0.3)
    assert not floor.take_disc(-2.9, 0.0, 0.3)


def test_end_of_the_hall_that_is_hardly_worth_it_may_be_cut_off(floor: FreeFloor) -> None:
    assert floor.take_box((2.0, -1.0), (2.6, 1.0))
