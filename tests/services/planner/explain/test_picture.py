"""Pictures of episodes: what is where, in which colour."""

import dataclasses

import numpy as np
import pytest

from readygo.common.drawing.plan_view import FREE, GOAL, HUMANS, OCCUPIED, ROBOT
from readygo.common.messages import Outcome
from readygo.services.planner.explain.picture import MOMENT_PX, draw_episode, draw_run, episode_view
from readygo.services.planner.explain.picture_layers import OUTCOMES, SIGHT, SIGHT_SHARE, SUPERSEDED, draw_knowledge
from tests.services.planner.runs import STEPS, WAY, Y_M, make_journal, make_run, make_scenario
from tests.services.planner.worlds import make_robot_planner, rooms

PERSON = [(0.0, 5.3)]


@pytest.fixture(scope="module")
def paper_planner():
    return make_robot_planner(mode="paper")


def has(picture, colour):
    return bool((picture == np.array(colour, np.uint8)).all(axis=2).any())


def pixel(picture, view, x, y):
    u, v = view.world_to_pixel([x, y])
    return tuple(picture[int(v), int(u)].tolist())


def shone_through(colour, share, ground=FREE):
    return tuple(round(ground * (1 - share) + value * share) for value in colour)


@pytest.mark.parametrize("outcome", list(Outcome))
def test_last_disc_and_headline_have_the_outcomes_colour(outcome):
    run = make_run(outcome=outcome)
    picture = draw_episode(rooms(), run.scenario, run.trajectory)
    view = episode_view(rooms(), run.scenario, run.trajectory, motions=None)
    assert pixel(picture[34:, 10:], view, *WAY[-1]) == OUTCOMES[outcome]
    assert tuple(picture[8, 12].tolist()) == OUTCOMES[outcome]


def test_map_way_person_and_goal_are_where_they_are():
    run = make_run(PERSON)
    picture = draw_episode(rooms(), run.scenario, run.trajectory, motions=run.motions)[34:, 10:]
    view = episode_view(rooms(), run.scenario, run.trajectory, motions=run.motions)
    assert pixel(picture, view, 0.5, Y_M) == ROBOT
    assert pixel(picture, view, 0.0, 5.3) == HUMANS[0]
    assert pixel(picture, view, 2.5, Y_M) == GOAL
    assert pixel(picture, view, 0.5, 4.1) == (OCCUPIED,) * 3
    assert pixel(picture, view, -1.0, 5.0) == (FREE,) * 3


def test_scenario_alone_shows_no_outcome():
    picture = draw_episode(rooms(), make_scenario(PERSON))
    assert has(picture, ROBOT)
    assert has(picture, HUMANS[0])
    assert not has(picture, OUTCOMES[Outcome.HUMAN_COLLISION])


def test_large_place_is_drawn_smaller():
    run = make_run()
    wide = dataclasses.replace(run.scenario, goal_xy_m=np.array([80.0, Y_M]))
    assert max(episode_view(rooms(), wide, None, motions=None).rgb.shape) <= 1100


def test_knowledge_shows_view_expectation_and_plan(paper_planner):
    seen = {10: (1.0, 5.3)}
    run = make_run(PERSON, journal=make_journal([WAY] * STEPS, searches=(0,), seen=seen))
    view = episode_view(rooms(), run.scenario, run.trajectory, motions=run.motions)
    picture = view.rgb.copy()
    draw_knowledge(picture, view, paper_planner, run, 10)
    assert pixel(picture, view, 2.0, 5.0) == shone_through(SIGHT, SIGHT_SHARE)
    assert pixel(picture, view, -2.5, 5.0) == (FREE,) * 3
    expected = np.array(pixel(picture, view, 1.0, 6.0)) - pixel(picture, view, 2.0, 6.0)
    assert expected[2] < -20 or expected[1] < -20
    assert pixel(picture, view, 1.5, Y_M) != shone_through(SIGHT, SIGHT_SHARE)


def test_walls_cut_the_view_where_they_hide_people():
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


def test_explained_picture_has_a_panel_per_moment_and_the_way_given_up(paper_planner):
    paths = [(WAY if k < 25 else WAY + np.array([0.0, 0.6]))[k:] for k in range(STEPS)]
    seen = {k: (0.0, 5.3) for k in range(12, 60)}
    run = make_run(PERSON, journal=make_journal(paths, searches=(0, 25), seen=seen))
    picture, alone = draw_run(paper_planner, run), draw_run(paper_planner, make_run())
    assert picture.shape[1] >= 3 * MOMENT_PX
    assert has(picture, SUPERSEDED)
    assert not has(alone, SUPERSEDED)
    for shown in (picture, alone):
        assert has(shown, shone_through(SIGHT, SIGHT_SHARE))


def test_picture_of_the_same_run_is_the_same(paper_planner):
    assert np.array_equal(draw_run(paper_planner, make_run(PERSON)), draw_run(paper_planner, make_run(PERSON)))
