import numpy as np
import pytest

from readygo.common.drawing.plan_view import FREE, HUMANS, ROBOT, WHITE
from readygo.services.planner.explain.picture import episode_view
from readygo.services.planner.explain.picture_layers import (
    SIGHT,
    SIGHT_SHARE,
    draw_changes,
    draw_closest,
    draw_knowledge,
    draw_superseded,
    draw_way,
    human_colour,
    put_label,
)
from tests.services.planner.explain.pixels import HUMAN, pixel, shone_through
from tests.services.planner.runs import STEPS, WAY, Y_M, make_journal, make_run
from tests.services.planner.worlds import make_robot_planner, rooms


def test_knowledge_shows_view_expectation_and_plan(paper_planner):
    seen = {10: (1.0, 5.3)}
    run = make_run(HUMAN, journal=make_journal([WAY] * STEPS, searches=(0,), seen=seen))
    view = episode_view(rooms(), run.scenario, run.trajectory, motions=run.motions)
    picture = view.rgb.copy()
    draw_knowledge(picture, view, paper_planner, run, 10)
    assert pixel(picture, view, 2.0, 5.0) == shone_through(SIGHT, SIGHT_SHARE)
    assert pixel(picture, view, -2.5, 5.0) == (FREE,) * 3
    expected = np.array(pixel(picture, view, 1.0, 6.0)) - pixel(picture, view, 2.0, 6.0)
    assert expected[2] < -20 or expected[1] < -20
    assert pixel(picture, view, 1.5, Y_M) != shone_through(SIGHT, SIGHT_SHARE)


def test_walls_cut_the_view_where_they_hide_humans():
    run = make_run(journal=make_journal([WAY[k:] for k in range(STEPS)], searches=(0,)))
    view = episode_view(rooms(), run.scenario, run.trajectory, motions=run.motions, margin_m=2.5)
    pictures = []
    for mode in ("paper", "spacetime"):
        picture = view.rgb.copy()
        draw_knowledge(picture, view, make_robot_planner(mode=mode), run, 40)
        pictures.append(picture)
    # A wall at y = 2 closes the room; the table between x = 0 and 1 ends at y = 4.5.
    behind, before = (2.0, 4.2), (1.5, 5.0)
    assert pixel(pictures[0], view, *behind) == shone_through(SIGHT, SIGHT_SHARE)
    assert pixel(pictures[0], view, *before) == pixel(pictures[1], view, *before)
    assert not np.array_equal(*pictures)


def blank(run):
    """The map of a run, and a picture to draw on."""
    view = episode_view(rooms(), run.scenario, run.trajectory, motions=run.motions)
    return view, view.rgb.copy()


def test_way_is_thick_up_to_its_end_and_thin_beyond():
    view, picture = blank(make_run())
    draw_way(picture, view, WAY, ROBOT, end=STEPS // 2)
    drawn = (picture != view.rgb).any(axis=2)
    before, beyond = (int(view.world_to_pixel([x, Y_M])[0]) for x in (-1.75, 1.25))
    assert drawn[:, before].sum() > drawn[:, beyond].sum() > 0


def test_way_has_a_dot_at_every_second_of_the_robots_clock():
    view, picture = blank(make_run())
    half = picture.copy()
    draw_way(picture, view, WAY, ROBOT, end=STEPS - 1)
    draw_way(half, view, WAY, ROBOT, end=STEPS - 1, rate_hz=40)
    dotted, seldom = ((drawn != view.rgb).any(axis=2).sum() for drawn in (picture, half))
    assert dotted > seldom


def test_plan_is_superseded_at_the_step_that_replaced_it_only():
    paths = [(WAY if k < 25 else WAY + np.array([0.0, 0.6]))[k:] for k in range(STEPS)]
    run = make_run(journal=make_journal(paths, searches=(0, 25)))
    for steps, shown in ((None, True), (range(25, 26), True), (range(26, 80), False), (range(25), False)):
        view, picture = blank(run)
        draw_superseded(picture, view, run, steps)
        assert np.array_equal(picture, view.rgb) != shown, steps


def test_change_of_way_is_marked_where_the_robot_was():
    paths = [(WAY if k < 40 else WAY + np.array([0.0, 0.6]))[k:] for k in range(STEPS)]
    run = make_run(journal=make_journal(paths, searches=(0, 40)))
    view, picture = blank(run)
    draw_changes(picture, view, run)
    assert pixel(picture, view, *WAY[20]) == (FREE,) * 3
    assert pixel(picture, view, *WAY[40]) == WHITE


def test_line_joins_robot_and_the_nearest_human_where_they_are_closest():
    run = make_run([(0.0, 5.8)], [(1.0, 5.3)])
    view, picture = blank(run)
    draw_closest(picture, view, run)
    assert max(pixel(picture, view, 1.0, 5.1)) < FREE
    assert pixel(picture, view, 0.0, 5.3) == (FREE,) * 3
    view, alone = blank(make_run())
    draw_closest(alone, view, make_run())
    assert np.array_equal(alone, view.rgb)


@pytest.mark.parametrize("place", [(-50, -50), (500, 500), (500, -50)])
def test_label_keeps_within_the_picture(place):
    picture = np.full((40, 120, 3), 100, np.uint8)
    inside = np.full((40, 120, 3), 100, np.uint8)
    put_label(picture, "1.23 m", place)
    put_label(inside, "1.23 m", (10, 20))
    assert (picture != 100).sum() > 0.85 * (inside != 100).sum() > 0


def test_colours_of_humans_come_in_turn():
    assert [human_colour(k) for k in range(len(HUMANS))] == list(HUMANS)
    assert human_colour(len(HUMANS)) == HUMANS[0]
