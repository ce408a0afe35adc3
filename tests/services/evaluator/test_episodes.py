import pytest

from readygo.common.errors import SceneError
from readygo.common.messages import EpisodeKey, Split
from readygo.services.evaluator import (
    EvaluateRequest,
    Task,
    handle_evaluate,
)


def test_rejected_scenarios_are_skipped_and_counted(make_evaluator):
    assert handle_evaluate(make_evaluator(), EvaluateRequest(episodes=3)).skipped == 2


def test_indices_do_not_depend_on_the_tasks_asked_for(make_evaluator):
    for task in Task:
        reply = handle_evaluate(make_evaluator(), EvaluateRequest(tasks=(task,), episodes=3))
        assert sorted({record.episode.index for record in reply.records}) == [0, 2, 4]


def test_scene_that_yields_no_episode_is_named(make_evaluator, services, monkeypatch):
    monkeypatch.setattr("readygo.services.evaluator.episodes.REJECTED_MAX", 20)
    services.reject_all = True
    with pytest.raises(SceneError, match="no way to the goal"):
        handle_evaluate(make_evaluator(), EvaluateRequest(episodes=1))
    assert len(services.requests) == 20


def test_next_accepted_scenario_takes_no_key_after_its_own(make_evaluator):
    keys = iter([EpisodeKey(seed=0, split=Split.TEST, index=index) for index in (1, 3, 4, 5)])
    episode, rejected = make_evaluator().source().next_accepted(keys)
    assert (episode.scenario.episode.index, rejected, next(keys).index) == (4, 2, 5)
