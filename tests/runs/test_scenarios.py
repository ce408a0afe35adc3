import itertools

import numpy as np
import pytest

from readygo.common.messages import AnimateRequest, EpisodeKey, HumanPlanRequest, Split
from readygo.runs.config import RunConfig
from readygo.runs.evaluation import evaluation_world
from readygo.runs.scenarios import accepted_scenarios
from readygo.services.animator import handle_animate
from readygo.services.planner import handle_human_plan


@pytest.fixture(scope="module")
def makers():
    world = evaluation_world("embedded", RunConfig(), avatars=None, seed=0, split=Split.TRAIN)
    return world.human_planner(), world.animator()


def test_scenarios_come_in_the_order_of_their_indices_without_the_rejected_ones(makers) -> None:
    planner, animator = makers
    drawn = list(accepted_scenarios(planner, animator, 1, Split.VAL, range(12)))
    indices = [scenario.episode.index for scenario, _ in drawn]
    assert indices == sorted(indices)
    for index in range(12):
        key = EpisodeKey(seed=1, split=Split.VAL, index=index)
        scenario = handle_human_plan(planner, HumanPlanRequest(episode=key)).scenario
        motions = handle_animate(animator, AnimateRequest(scenario=scenario)).motions if scenario else None
        assert (index in indices) == (motions is not None)
        if motions is not None:
            assert drawn[indices.index(index)][0].episode == key
            for human, again in zip(motions.humans, drawn[indices.index(index)][1].humans, strict=True):
                np.testing.assert_array_equal(human.motion.root_m, again.motion.root_m)


def test_scenarios_are_drawn_when_they_are_asked_for_and_static_ones_have_no_humans(makers) -> None:
    endless = accepted_scenarios(*makers, 0, Split.TRAIN, itertools.count(), static=True)
    for scenario, motions in itertools.islice(endless, 2):
        assert not scenario.humans
        assert not motions.humans
