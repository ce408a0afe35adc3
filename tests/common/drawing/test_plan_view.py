"""Drawing on maps: what lands where."""

import cv2
import numpy as np
import pytest

from readygo.common.drawing.plan_view import (
    FREE,
    HUMANS,
    OCCUPIED,
    ROBOT,
    WHITE,
    DrawnEpisode,
    draw_arrow_head,
    draw_disc,
    draw_episodes,
    draw_goal,
    draw_path,
    draw_ring,
    draw_robot,
    draw_scale_bar,
    fade_view,
    fill_area,
    fill_band,
    map_view,
    map_window,
    put_mark,
    put_text,
    resize_view,
    text_width_px,
)
from readygo.common.maps import GridFrame, OccupancyMap

RED = (200, 0, 0)


@pytest.fixture
def occupancy() -> OccupancyMap:
    """2 x 1 m from (-1, 2) on; the cell at the lower left and the last row are occupied."""
    occupied = np.zeros((10, 20), np.bool_)
    occupied[0, 0] = occupied[-1] = True
    return OccupancyMap(frame=GridFrame(origin_x_m=-1.0, origin_y_m=2.0, resolution_m=0.1), occupied=occupied)


def grey(view, x, y):
    u, v = view.world_to_pixel([x, y])
    return int(view.rgb[int(v), int(u), 0])


def test_window_shows_the_cells_in_their_places(occupancy) -> None:
    view = map_window(occupancy, np.array([-1.0, 2.0]), np.array([0.5, 3.0]), pixel_m=0.02)
    assert view.rgb.shape == (50, 75, 3)
    assert grey(view, -0.95, 2.05) == OCCUPIED
    assert grey(view, -0.85, 2.05) == FREE
    assert grey(view, 0.3, 2.95) == OCCUPIED


def test_beyond_the_map_all_is_occupied(occupancy) -> None:
    view = map_window(occupancy, np.array([-3.0, 0.0]), np.array([3.0, 5.0]), pixel_m=0.05)
    for x, y in ((-2.0, 2.5), (2.0, 2.5), (0.0, 1.0), (0.0, 4.0)):
        assert grey(view, x, y) == OCCUPIED
    assert grey(view, 0.9, 2.5) == FREE


def test_whole_map_has_four_pixels_a_cell(occupancy) -> None:
    view = map_view(occupancy)
    assert view.rgb.shape == (40, 80, 3)
    assert np.array_equal(view.rgb[:, :, 0] == OCCUPIED, occupancy.occupied[::-1].repeat(4, axis=0).repeat(4, axis=1))


def test_area_lets_the_ground_shine_through(occupancy) -> None:
    view = map_window(occupancy, np.array([-1.0, 2.0]), np.array([1.0, 3.0]), pixel_m=0.01)
    picture = view.rgb.copy()
    corners = np.array([[-0.5, 2.2], [0.5, 2.2], [0.5, 2.6], [-0.5, 2.6]])
    fill_area(picture, view, corners, RED, share=0.4)
    u, v = (int(value) for value in view.world_to_pixel([0.0, 2.4]))
    assert tuple(picture[v, u].tolist()) == (230, 150, 150)
    u, v = (int(value) for value in view.world_to_pixel([0.7, 2.4]))
    assert tuple(picture[v, u].tolist()) == (FREE,) * 3


def test_area_outside_of_the_picture_changes_nothing(occupancy) -> None:
    view = map_view(occupancy)
    picture = view.rgb.copy()
    fill_area(picture, view, np.array([[50.0, 50.0], [51.0, 50.0], [51.0, 51.0]]), RED, share=0.5)
    assert np.array_equal(picture, view.rgb)


@pytest.mark.parametrize("path", [[[0.0, 2.5]], [[-0.2, 2.5], [0.2, 2.5]]])
def test_band_reaches_its_radius_around_a_path_or_a_point(occupancy, path) -> None:
    view = map_window(occupancy, np.array([-1.0, 2.0]), np.array([1.0, 3.0]), pixel_m=0.01)
    picture = view.rgb.copy()
    fill_band(picture, view, np.array(path), 0.2, RED, share=0.5)
    touched = np.argwhere((picture != view.rgb).any(axis=2))
    height_m, width_m = (np.ptp(touched, axis=0) + 1) * 0.01
    assert height_m == pytest.approx(0.4, abs=0.04)
    assert width_m == pytest.approx(0.4 + np.ptp(np.array(path)[:, 0]), abs=0.04)


@pytest.mark.parametrize(("pixel_m", "length_px"), [(0.02, 25), (0.5, 40)])
def test_scale_bar_is_round_and_short(pixel_m, length_px) -> None:
    occupied = np.zeros((10, 10), np.bool_)
    frame = GridFrame(origin_x_m=0.0, origin_y_m=0.0, resolution_m=0.5)
    view = map_window(
        OccupancyMap(frame=frame, occupied=occupied), np.zeros(2), np.full(2, 200 * pixel_m), pixel_m=pixel_m
    )
    picture = view.rgb.copy()
    draw_scale_bar(picture, view)
    dark = np.flatnonzero(picture[-12].max(axis=1) < 60)
    assert np.ptp(dark) == length_px


@pytest.mark.parametrize("ground", [0, 128, 255])
def test_caption_with_a_halo_stands_out_from_any_ground(ground) -> None:
    picture = np.full((30, 120, 3), ground, np.uint8)
    put_text(picture, "caption", (8, 20), halo=WHITE)
    assert picture.min() < 80, "dark letters"
    letters = np.zeros_like(picture)
    put_text(letters, "caption", (8, 20), colour=WHITE)
    near, far = (cv2.dilate(letters, np.ones((size, size))).max(axis=2) > 0 for size in (1, 3))
    assert np.median(picture[far & ~near]) > 180, "on white"


def test_plan_is_drawn_as_it_was(occupancy, golden_figures) -> None:
    """Every mark once on a faded window that is no multiple of the cells."""
    view = fade_view(map_window(occupancy, np.array([-1.13, 1.9]), np.array([1.21, 3.17]), pixel_m=0.017), share=0.4)
    picture = view.rgb.copy()
    path = np.array([[-0.8, 2.2], [0.1, 2.7], [0.6, 2.3], [0.9, 2.9]])
    fill_band(picture, view, path, 0.11, RED, share=0.3)
    fill_area(picture, view, path + np.array([0.0, 0.1]), (0, 0, 200), share=0.6)
    draw_path(picture, view, path, (0, 120, 0))
    draw_disc(picture, view, (-0.4, 2.9), 0.13, (120, 0, 90))
    draw_ring(picture, view, (0.3, 2.3), 0.17, (10, 90, 60))
    draw_goal(picture, view, (0.8, 2.5), radius_m=0.21)
    draw_robot(picture, view, np.array([-0.6, 2.5, 2.5]), 0.12)
    draw_arrow_head(picture, view, path, (0, 50, 200))
    put_mark(picture, view, (0.0, 2.1), "7", (200, 100, 0))
    draw_scale_bar(picture, view)
    golden_figures("drawing/plan", picture.reshape(-1, 3) / 64.0)
    smaller = resize_view(view, 41)
    golden_figures("drawing/smaller plan", smaller.rgb.reshape(-1, 3) / 64.0)
    expected = np.array(view.world_to_pixel((0.3, 2.4))) * 41 / len(view.rgb)
    assert smaller.world_to_pixel((0.3, 2.4)) == pytest.approx(expected, abs=0.6)
    golden_figures("drawing/text widths", [text_width_px(text, size=0.6) for text in ("", "i", "wide words")])


def test_ways_of_robot_and_humans_are_drawn_in_their_colours(occupancy) -> None:
    view = map_window(occupancy, np.array([-1.0, 2.0]), np.array([1.0, 3.0]), pixel_m=0.01)
    ways = [np.array([[-0.8, y], [0.8, y]]) for y in (2.2, 2.5, 2.8)]
    drawn = DrawnEpisode(label="0", robot_xy_m=ways[0], goal_xy_m=np.array([0.8, 2.2]), humans_xy_m=tuple(ways[1:]))
    picture = draw_episodes(view, [drawn])
    for way, colour in zip(ways, (ROBOT, *HUMANS), strict=False):
        for x in (-0.5, 0.0, 0.5):
            u, v = (int(value) for value in view.world_to_pixel([x, way[0, 1]]))
            assert tuple(picture[v, u].tolist()) == colour
