"""Humans who make way for whoever drives."""

import dataclasses

import numpy as np
import pytest

from readygo.common.messages import Split
from readygo.runs.config import load_run_config
from readygo.runs.evaluation import evaluation_world, make_evaluator, make_request
from readygo.services.evaluator import Task
from readygo.services.evaluator.episodes import as_task


@pytest.fixture(scope="module")
def evaluator():
    return make_evaluator(evaluation_world("embedded", load_run_config(None), avatars=None, seed=0))


@pytest.fixture(scope="module")
def episode(evaluator):
    request = make_request(1, ("dynamic",), ("expert",), Split.TEST, 0)
    ((episode,), _) = evaluator.source().draw(seed=0, split=request.split, count=1, tasks=request.tasks)
    return episode


def walked(simulation, v_mps, steps=80):
    for _ in range(steps):
        if simulation.outcome is not None:
            break
        simulation.advance(v_mps, 0.0)
    return np.array([simulation.human_xy_at(step) for step in range(simulation.step + 1)])


def test_only_the_reactive_task_has_humans_who_look(evaluator, episode):
    blind = walked(evaluator.simulation(episode), 0.0)
    roots = episode.motions.humans[0].motion.root_m[: len(blind), :2]
    assert blind[: len(roots), 0] == pytest.approx(roots.astype(float))
    simulation = evaluator.simulation(as_task(episode, Task.REACTIVE))
    walked(simulation, 0.0)
    assert simulation.motions_so_far() is not simulation.motions


def test_they_have_bodies_that_walk_where_they_are(evaluator, episode):
    simulation = evaluator.simulation(as_task(episode, Task.REACTIVE))
    places = walked(simulation, 0.0, 40)
    for k, human in enumerate(simulation.motions_so_far().humans):
        motion = human.motion
        assert len(motion.root_m) == simulation.step + 1
        assert motion.root_m[:, :2] == pytest.approx(places[:, k], abs=1e-4)
        assert np.abs(np.diff(motion.pose_axis_angle[:, 1:], axis=0)).max() < 0.8, "no jumps from step to step"
        assert 0.6 < motion.root_m[:, 2].min() < motion.root_m[:, 2].max() < 1.3


def test_settings_let_the_dynamic_task_react(evaluator, episode):
    config = load_run_config(None)
    config = dataclasses.replace(config, human_planner=dataclasses.replace(config.human_planner, reactive=True))
    reactive = make_evaluator(evaluation_world("embedded", config, avatars=None, seed=0))
    simulation = reactive.simulation(episode)
    assert simulation.motions_so_far() is not simulation.motions
    ((drawn,), _) = reactive.source().draw(seed=0, split=Split.TEST, count=1, tasks=(Task.DYNAMIC,))
    assert np.array_equal(drawn.scenario.humans[0].xy_m, episode.scenario.humans[0].xy_m), "drawn as without"
