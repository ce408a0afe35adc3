import dataclasses

import numpy as np
import pytest

from readygo.common.scenes.embedded.lighting import Lights, lit_colours, voxelise
from readygo.common.scenes.embedded.surfaces import Surfaces

DARK = Lights(
    position_m=np.zeros((1, 3)),
    direction=np.zeros((1, 3)),
    power=np.zeros((1, 3)),
    sun_direction=np.array([0.0, 0.0, 1.0]),
    sun_power=np.zeros(3),
)


def brightness(build: Surfaces, lights: Lights) -> np.ndarray:
    """Red of all samples in the light; the grid is 2 x 3 x 2.1 m."""
    grid = voxelise(build.solid_points_m(), np.array([-1.0, -1.0, -0.05]), np.array([1.0, 2.0, 2.05]))
    return lit_colours(build.samples(), grid, lights)[:, 0]


def tile(build: Surfaces, x: float, y: float, *, glows: bool = False) -> None:
    """One sample of grey floor that faces up."""
    build.patch((x - 0.1, y - 0.1, 0.0), (0.2, 0, 0), (0, 0.2, 0), 0.2, (0.5, 0.5, 0.5), glows=glows)


@pytest.fixture
def build() -> Surfaces:
    """A wall along x at y 0.45..0.55."""
    build = Surfaces(np.random.default_rng(0))
    build.solid((-1.0, 0.45, 0.0), (1.0, 0.55, 2.0))
    return build


def test_surface_behind_a_wall_stays_darker_than_one_before_it(build: Surfaces) -> None:
    tile(build, 0.0, 0.2)
    tile(build, 0.0, 0.8)
    lamp = dataclasses.replace(DARK, position_m=np.array([[0.0, -0.5, 1.0]]), power=np.ones((1, 3)))
    before, behind = brightness(build, lamp)
    assert before > 2 * behind


def test_window_shines_only_where_it_faces(build: Surfaces) -> None:
    tile(build, 0.0, -0.8)
    window = dataclasses.replace(DARK, position_m=np.array([[0.0, 0.0, 0.5]]), power=np.ones((1, 3)))
    (towards,) = brightness(build, dataclasses.replace(window, direction=np.array([[0.0, -1.0, 0.0]])))
    (away,) = brightness(build, dataclasses.replace(window, direction=np.array([[0.0, 1.0, 0.0]])))
    assert towards > 0.1
    assert away == 0.0


def test_sun_shines_past_a_wall_and_not_through_it(build: Surfaces) -> None:
    tile(build, 0.0, 0.2)
    tile(build, 0.0, 1.8)
    slanting = np.array([0.0, -np.sqrt(0.5), np.sqrt(0.5)])
    shaded_0, lit_0 = brightness(
        build, dataclasses.replace(DARK, sun_direction=-slanting * (1, 1, -1), sun_power=np.ones(3))
    )
    lit_1, shaded_1 = brightness(build, dataclasses.replace(DARK, sun_direction=slanting, sun_power=np.ones(3)))
    assert min(lit_0, lit_1) > 0.3
    assert shaded_0 < 0.5 * lit_0
    assert shaded_1 < lit_1


def test_glowing_surface_keeps_its_colour_and_lights_what_faces_it(build: Surfaces) -> None:
    tile(build, 0.0, 0.0)
    build.patch((-0.5, -0.8, 1.0), (0, 1.0, 0), (1.0, 0, 0), 0.1, (0.9, 0.9, 0.9), glows=True)
    build.solid((-0.5, -0.8, 1.0), (0.5, 0.2, 1.05))
    colours = brightness(build, DARK)
    np.testing.assert_array_equal(colours[1:], 0.9)
    assert colours[0] > 0.05


def test_voxels_hold_the_points_inside_of_the_grid() -> None:
    points = np.array([[0.01, 0.06, 0.11], [0.01, 0.06, 0.14], [-0.01, 0.0, 0.0], [0.0, 0.0, 0.21]])
    grid = voxelise(points, np.zeros(3), np.array([0.1, 0.1, 0.2]))
    assert grid.solid.shape == (2, 2, 4)
    assert np.argwhere(grid.solid).tolist() == [[0, 1, 2]]


def test_room_is_lit_as_it_was(golden_figures) -> None:
    """A table in a corner, a window, a lamp and a low sun; some of it glows, some is thin."""
    build = Surfaces(np.random.default_rng(2))
    build.box((-1.0, -1.0, 0.0), (1.0, 2.0, 2.0), 0.21, (0.6, 0.5, 0.4), faces=("left", "back", "bottom"))
    build.box((-0.3, 0.2, 0.0), (0.4, 0.9, 0.7), 0.11, (0.3, 0.6, 0.8))
    build.blob((0.5, -0.4, 0.6), (0.2, 0.2, 0.3), 0.12, (0.8, 0.3, 0.2))
    tile(build, 0.1, -0.3, glows=True)
    lights = Lights(
        position_m=np.array([[-0.8, -0.7, 1.3], [0.6, 1.6, 1.7]]),
        direction=np.array([[0.8, 0.6, 0.0], [0.0, 0.0, 0.0]]),
        power=np.array([[1.4, 1.2, 0.9], [0.5, 0.7, 0.8]]),
        sun_direction=np.array([0.48, -0.6, 0.64]),
        sun_power=np.array([2.2, 2.0, 1.5]),
    )
    grid = voxelise(build.solid_points_m(), np.array([-1.1, -1.1, -0.05]), np.array([1.1, 2.1, 2.05]))
    golden_figures("embedded/lit room", 9.0 * lit_colours(build.samples(), grid, lights))
    golden_figures("embedded/solid voxels", np.argwhere(grid.solid))
