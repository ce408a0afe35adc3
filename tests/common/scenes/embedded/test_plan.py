import itertools

import pytest

from readygo.common.scenes.embedded.plan import CEILING_M, FLAT, Opening, pieces


def test_doorways_are_at_least_one_metre_wide() -> None:
    assert min(o.end_m - o.begin_m for o in FLAT.openings if not o.is_window) >= 1.0
    assert all(o.top_m >= 2.0 for o in FLAT.openings if not o.is_window)


def test_openings_lie_in_their_walls_side_by_side() -> None:
    for name, wall in FLAT.walls.items():
        openings = FLAT.openings_of(name)
        assert openings == sorted(openings, key=lambda opening: opening.begin_m)
        edges = [edge for opening in openings for edge in (opening.begin_m, opening.end_m)]
        assert edges == sorted(edges)
        assert all(wall.begin_m < edge < wall.end_m for edge in edges)
    assert sum(len(FLAT.openings_of(name)) for name in FLAT.walls) == len(FLAT.openings)


def test_rooms_do_not_overlap() -> None:
    for one, other in itertools.combinations(FLAT.rooms, 2):
        across = min(one.x_m[1], other.x_m[1]) - max(one.x_m[0], other.x_m[0])
        along = min(one.y_m[1], other.y_m[1]) - max(one.y_m[0], other.y_m[0])
        assert min(across, along) <= 0.0, (one.name, other.name)


def test_face_without_openings_is_one_piece() -> None:
    assert pieces(0.0, 3.0, [Opening(wall="a", begin_m=4.0, end_m=5.0)]) == [(0.0, 3.0, 0.0, CEILING_M)]


def test_door_leaves_its_lintel_and_window_its_sill_too() -> None:
    door = Opening(wall="a", begin_m=1.0, end_m=2.0, top_m=2.0)
    window = Opening(wall="a", begin_m=3.0, end_m=4.0, bottom_m=0.8, top_m=2.2)
    assert pieces(0.0, 4.0, [door, window]) == [
        (0.0, 1.0, 0.0, CEILING_M),
        (1.0, 2.0, 2.0, CEILING_M),
        (2.0, 3.0, 0.0, CEILING_M),
        (3.0, 4.0, 0.0, 0.8),
        (3.0, 4.0, 2.2, CEILING_M),
    ]


@pytest.mark.parametrize("opening", FLAT.openings)
def test_what_is_cut_out_of_a_wall_is_what_its_openings_take(opening: Opening) -> None:
    wall = FLAT.walls[opening.wall]
    whole = (wall.end_m - wall.begin_m) * CEILING_M
    rest = sum((end - begin) * (top - low) for begin, end, low, top in pieces(wall.begin_m, wall.end_m, [opening]))
    assert whole - rest == pytest.approx((opening.end_m - opening.begin_m) * (opening.top_m - opening.bottom_m))
