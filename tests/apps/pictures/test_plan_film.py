import numpy as np
import pytest

from readygo.apps.pictures import plan_film
from readygo.apps.pictures.plan_film import GIVEN_UP_S, run_film
from tests.services.planner.runs import STEPS, WAY, make_journal, make_run
from tests.services.planner.worlds import make_robot_planner


@pytest.fixture(scope="module")
def planner():
    return make_robot_planner(mode="paper")


def test_film_has_a_picture_per_step_and_shows_what_the_expert_sees(planner) -> None:
    pictures = list(run_film(planner, make_run([(0.0, 5.3)])))
    assert len(pictures) == STEPS
    assert len({picture.shape for picture in pictures}) == 1
    assert not np.array_equal(pictures[0], pictures[-1])


def test_plan_that_was_given_up_fades_after_a_second(planner, monkeypatch: pytest.MonkeyPatch) -> None:
    shown = []
    monkeypatch.setattr(plan_film, "draw_superseded", lambda picture, view, run, steps: shown.append(steps))
    paths = [(WAY if k < 25 else WAY + np.array([0.0, 0.6]))[k:] for k in range(STEPS)]
    list(run_film(planner, make_run(journal=make_journal(paths, searches=(0, 25)))))
    assert [k for k, steps in enumerate(shown) if 25 in steps] == list(range(25, 25 + round(GIVEN_UP_S * 20) + 1))
