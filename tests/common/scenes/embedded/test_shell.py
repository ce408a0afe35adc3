import numpy as np
import pytest

from readygo.common.scenes.embedded.plan import CEILING_M, FLAT, Opening, Room
from readygo.common.scenes.embedded.shell import along_wall, build_shell, facing_wall
from readygo.common.scenes.embedded.surfaces import Surfaces
from tests.common.scenes.embedded.parts import rows_of

SIDES = ("north", "east", "south", "west")


@pytest.fixture(scope="module")
def shell() -> Surfaces:
    build = Surfaces(np.random.default_rng(0))
    build_shell(build, FLAT)
    return build


@pytest.mark.parametrize("side", SIDES)
@pytest.mark.parametrize("room", FLAT.rooms, ids=lambda room: room.name)
def test_placement_on_a_wall_starts_in_its_left_corner_and_looks_into_it(room: Room, side: str) -> None:
    wall, length = facing_wall(Surfaces(np.random.default_rng(0)), room, side)
    wall.add(np.array([[0, 0, 0], [length, 0, 0], [length / 2, -0.1, 0]]), (1, 0, 0), (0, 0, 1), 0.01, (1, 1, 1))
    left, right, before = wall.samples().position_m[:, :2]
    outwards = {"north": (0, 1), "east": (1, 0), "south": (0, -1), "west": (-1, 0)}[side]
    corners = {(x, y) for x in room.x_m for y in room.y_m}
    for corner in (left, right):
        assert min(np.hypot(*(corner - known)) for known in corners) < 1e-9
    np.testing.assert_allclose((right - left) / length, (outwards[1], -outwards[0]), atol=1e-9)
    np.testing.assert_allclose(before, (left + right) / 2 - 0.1 * np.array(outwards), atol=1e-9)


def test_opening_is_measured_from_the_left_corner_of_either_side() -> None:
    door = Opening(wall="hall_north", begin_m=-2.8, end_m=-0.9)
    living_room, hall = FLAT.rooms[0], FLAT.rooms[2]
    assert along_wall(hall, "north", door) == pytest.approx((2.4, 4.3))
    assert along_wall(living_room, "south", door) == pytest.approx((1.4, 3.3))
    window, study = Opening(wall="east", begin_m=-3.4, end_m=-2.2), FLAT.rooms[4]
    assert along_wall(study, "east", window) == pytest.approx((1.0, 2.2))
    assert along_wall(study, "west", window) == pytest.approx((1.4, 2.6))


def inside(points: np.ndarray, opening: Opening, margin_m: float) -> np.ndarray:
    """Whether points lie in the free space of an opening, away from its frame."""
    wall = FLAT.walls[opening.wall]
    along, across = (points[:, 0], points[:, 1]) if wall.axis == "y" else (points[:, 1], points[:, 0])
    free = (along > opening.begin_m + margin_m) & (along < opening.end_m - margin_m)
    free &= (points[:, 2] > opening.bottom_m + margin_m) & (points[:, 2] < opening.top_m - margin_m)
    return free & (across > wall.low_m - 1e-6) & (across < wall.high_m + 1e-6)


@pytest.mark.parametrize("opening", FLAT.openings)
def test_light_passes_openings_but_for_the_bars_of_windows(shell: Surfaces, opening: Opening) -> None:
    taken = inside(shell.solid_points_m(), opening, 0.07)
    if opening.is_window:
        wall, middle = FLAT.walls[opening.wall], (opening.begin_m + opening.end_m) / 2
        along = shell.solid_points_m()[taken, 0 if wall.axis == "y" else 1]
        assert np.abs(along - middle).max() < 0.031
    else:
        assert not taken.any()


def test_walls_are_solid_from_the_floor_to_the_ceiling(shell: Surfaces) -> None:
    points = shell.solid_points_m()
    for x, y in ((-5.3, 0.8), (5.3, -4.0), (0.55, 3.5), (-0.15, -3.0), (-4.0, 0.55)):
        near = (np.abs(points[:, 0] - x) < 0.05) & (np.abs(points[:, 1] - y) < 0.05)
        heights = np.sort(points[near, 2])
        assert np.diff(heights).max() < 0.05
        assert heights[0] < 0.05
        assert heights[-1] > CEILING_M - 0.05


def test_rooms_see_painted_walls_and_a_ceiling_that_looks_down(shell: Surfaces) -> None:
    samples = shell.samples()
    ceiling = samples.position_m[:, 2] == CEILING_M
    assert (samples.normal[ceiling, 2] == -1.0).all()
    x, y, z = samples.position_m.T
    west = (np.abs(x + 5.2) < 1e-9) & (y > 3.2) & (y < 4.7) & (z > 0.2) & (z < 2.5)
    assert west.sum() > 50
    np.testing.assert_allclose(samples.normal[west], np.tile((1, 0, 0), (west.sum(), 1)), atol=1e-9)
    assert (samples.colour[west, 1] > samples.colour[west, 0]).all()


def test_shell_is_as_it_was(shell: Surfaces, golden_figures) -> None:
    golden_figures("embedded/shell", *rows_of(shell.samples()))
    golden_figures("embedded/shell solid", shell.solid_points_m())
