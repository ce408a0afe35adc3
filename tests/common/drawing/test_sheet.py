import numpy as np
import pytest

from readygo.common.drawing.plan_view import FREE, GOAL, INK, ROBOT, WHITE
from readygo.common.drawing.sheet import (
    GAP_PX,
    area_swatch,
    dotted_swatch,
    line_swatch,
    ring_swatch,
    sheet,
    stack_panels,
)


def plain(height, width, colour):
    return np.full((height, width, 3), colour, np.uint8)


def drawn(swatch):
    picture = plain(40, 40, WHITE)
    swatch(picture, 20, 20)
    return picture


def test_pictures_stand_side_by_side_below_the_headline_and_above_the_legend():
    rows = [[plain(50, 300, ROBOT), plain(30, 200, GOAL)], [plain(20, 100, INK)]]
    picture = sheet(rows, [("Title", INK)], [(line_swatch(INK), "a line")])
    assert picture.shape[1] == 300 + GAP_PX + 200 + 2 * GAP_PX
    robot, goal = (np.argwhere((picture == colour).all(axis=2)) for colour in (ROBOT, GOAL))
    assert len(robot) == 50 * 300
    assert len(goal) == 30 * 200
    (top, left), (other_top, other_left) = robot.min(axis=0), goal.min(axis=0)
    assert (top, left) == (other_top, GAP_PX)
    assert other_left == left + 300 + GAP_PX
    below = picture[top + 50 + GAP_PX : top + 50 + GAP_PX + 20, GAP_PX : GAP_PX + 100]
    assert (below == INK).all()
    assert (picture[:top] != WHITE).any()
    assert (picture[top + 50 + 20 + 2 * GAP_PX :] != WHITE).any()


def test_legend_wraps_where_its_row_is_full():
    def height(items):
        return len(sheet([[plain(10, 10, INK)]], [], [(ring_swatch(INK), "some words")] * items))

    assert height(1) == height(2) < height(9) < height(30)


def test_stacked_pictures_have_a_gap_between_them():
    picture = stack_panels([plain(5, 8, INK), plain(7, 8, GOAL)])
    assert picture.shape == (12 + GAP_PX, 8, 3)
    assert (picture[:5] == INK).all()
    assert (picture[5:-7] == 255).all()
    assert (picture[-7:] == GOAL).all()


@pytest.mark.parametrize("swatch", [line_swatch(ROBOT), dotted_swatch(ROBOT), ring_swatch(ROBOT)])
def test_swatches_are_drawn_around_their_point_in_their_colour(swatch):
    marked = np.argwhere((drawn(swatch) == ROBOT).all(axis=2))
    assert len(marked) > 10
    assert np.abs(marked.mean(axis=0) - 20).max() < 1.0


def test_open_ring_has_no_dot():
    assert (drawn(ring_swatch(ROBOT))[20, 20] == ROBOT).all()
    assert (drawn(ring_swatch(ROBOT, filled=False))[20, 20] == 255).all()


def test_area_lets_free_ground_shine_through_inside_of_its_edge():
    picture = drawn(area_swatch((200, 0, 0), 0.4))
    assert picture[20, 20].tolist() == [round(FREE * 0.6 + 80), round(FREE * 0.6), round(FREE * 0.6)]
    assert picture[20, 10].tolist() == [200, 0, 0]


def test_sheet_is_drawn_as_it_was(golden_figures):
    swatches = [(line_swatch(ROBOT, 3), "line"), (dotted_swatch(GOAL), "dots"), (ring_swatch(INK), "ring")]
    swatches += [(ring_swatch(GOAL, filled=False), "hollow"), (area_swatch(ROBOT, 0.4), "area with a long name")]
    rows = [[plain(31, 140, ROBOT), plain(23, 90, GOAL)], [plain(17, 60, INK)]]
    picture = sheet(rows, [("A title", INK), ("that goes on", GOAL)], swatches)
    golden_figures("drawing/sheet", picture.reshape(-1, 3) / 64.0)
    golden_figures("drawing/sheet size", picture.shape, scale=0.1)
