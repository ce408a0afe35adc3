"""Pictures of episodes: what is where, in which colour."""

import dataclasses

import numpy as np
import pytest

from readygo.common.drawing.plan_view import FREE, GOAL, HUMANS, OCCUPIED, ROBOT
from readygo.common.messages import Outcome
from readygo.services.planner.explain.picture import MOMENT_PX, draw_episode, draw_run, episode_view
from readygo.services.planner.explain.picture_layers import ADVICE, OUTCOMES, SIGHT, SIGHT_SHARE, SUPERSEDED
from tests.services.planner.explain.pixels import HUMAN, has, pixel, shone_through
from tests.services.planner.runs import STEPS, WAY, Y_M, make_journal, make_run, make_scenario
from tests.services.planner.worlds import rooms


@pytest.mark.parametrize("outcome", list(Outcome))
def test_last_disc_and_headline_have_the_outcomes_colour(outcome):
    run = make_run(outcome=outcome)
    picture = draw_episode(rooms(), run.scenario, run.trajectory)
    view = episode_view(rooms(), run.scenario, run.trajectory, motions=None)
    assert pixel(picture[34:, 10:], view, *WAY[-1]) == OUTCOMES[outcome]
    assert tuple(picture[8, 12].tolist()) == OUTCOMES[outcome]


def test_map_way_human_and_goal_are_where_they_are():
    run = make_run(HUMAN)
    picture = draw_episode(rooms(), run.scenario, run.trajectory, motions=run.motions)[34:, 10:]
    view = episode_view(rooms(), run.scenario, run.trajectory, motions=run.motions)
    assert pixel(picture, view, 0.5, Y_M) == ROBOT
    assert pixel(picture, view, 0.0, 5.3) == HUMANS[0]
    assert pixel(picture, view, 2.5, Y_M) == GOAL
    assert pixel(picture, view, 0.5, 4.1) == (OCCUPIED,) * 3
    assert pixel(picture, view, -1.0, 5.0) == (FREE,) * 3


def test_scenario_alone_shows_no_outcome():
    picture = draw_episode(rooms(), make_scenario(HUMAN))
    assert has(picture, ROBOT)
    assert has(picture, HUMANS[0])
    assert not has(picture, OUTCOMES[Outcome.HUMAN_COLLISION])


def test_large_place_is_drawn_smaller():
    run = make_run()
    wide = dataclasses.replace(run.scenario, goal_xy_m=np.array([80.0, Y_M]))
    assert max(episode_view(rooms(), wide, None, motions=None).rgb.shape) <= 1100


def test_explained_picture_has_a_panel_per_moment_and_the_way_given_up(paper_planner):
    paths = [(WAY if k < 25 else WAY + np.array([0.0, 0.6]))[k:] for k in range(STEPS)]
    seen = {k: (0.0, 5.3) for k in range(12, 60)}
    run = make_run(HUMAN, journal=make_journal(paths, searches=(0, 25), seen=seen))
    picture, alone = draw_run(paper_planner, run), draw_run(paper_planner, make_run())
    assert picture.shape[1] >= 3 * MOMENT_PX
    assert has(picture, SUPERSEDED)
    assert not has(alone, SUPERSEDED)
    for shown in (picture, alone):
        assert has(shown, shone_through(SIGHT, SIGHT_SHARE))


def test_picture_of_the_same_run_is_the_same(paper_planner):
    assert np.array_equal(draw_run(paper_planner, make_run(HUMAN)), draw_run(paper_planner, make_run(HUMAN)))


def test_run_of_a_policy_shows_what_it_saw_and_what_the_expert_would_do_but_no_plans_of_its_own(paper_planner):
    paths = [(WAY if k < 25 else WAY + np.array([0.0, 0.6]))[k:] for k in range(STEPS)]
    run = dataclasses.replace(make_run(HUMAN, journal=make_journal(paths, searches=(0, 25))), driver="policy")
    shown = []

    def look(step):
        shown.append(step)
        return np.full((30, 50, 3), (250, 0, 250), np.uint8)

    picture, without = draw_run(paper_planner, run, look), draw_run(paper_planner, run)
    assert shown
    assert has(picture, (250, 0, 250))
    assert len(picture) > len(without) or picture.shape[1] > without.shape[1]
    for image in (picture, without):
        assert has(image, ADVICE)
        assert not has(image, SUPERSEDED)


def test_pictures_are_drawn_as_they_were(paper_planner, golden_figures):
    paths = [(WAY if k < 25 else WAY + np.array([0.0, 0.6]))[k:] for k in range(STEPS)]
    run = make_run(HUMAN, journal=make_journal(paths, searches=(0, 25), seen={k: (0.0, 5.3) for k in range(12, 60)}))
    for name, picture in (
        ("run", draw_run(paper_planner, run)),
        ("episode", draw_episode(rooms(), run.scenario, run.trajectory, motions=run.motions)),
        ("scenario", draw_episode(rooms(), make_scenario(HUMAN))),
    ):
        golden_figures(f"explain/{name}", picture[::2, ::2].reshape(-1, 3) / 64.0)
        golden_figures(f"explain/{name} size", picture.shape, scale=0.1)
