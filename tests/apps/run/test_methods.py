import dataclasses
from pathlib import Path

import pytest

from readygo.apps.run.config import load_run_config
from readygo.apps.run.evaluation import evaluation_world, make_evaluator, make_request
from readygo.apps.run.methods import BLIND, named_methods, needs_renderer
from readygo.common.errors import PolicyError
from readygo.common.messages import RobotPlanRequest, Split
from readygo.services.evaluator import handle_evaluate
from readygo.services.planner import handle_robot_plan


@pytest.fixture(scope="module")
def world():
    config = load_run_config(None)
    short = dataclasses.replace(config.episode, goal_distance_max_m=4.0, time_limit_s=15.0)
    return evaluation_world("embedded", dataclasses.replace(config, episode=short), avatars=None, seed=0)


def test_blind_methods_drive_without_a_renderer(world):
    assert not needs_renderer(BLIND)
    assert needs_renderer(("expert", "gnm"))
    request = make_request(1, ("static",), BLIND, Split.TEST, 0)
    reply = handle_evaluate(make_evaluator(world), request)
    assert [record.method for record in reply.records] == list(BLIND)
    assert all(record.reason == "" for record in reply.records)


def test_expert_drives_as_it_does_for_data(world):
    reply = handle_evaluate(make_evaluator(world), make_request(1, ("dynamic",), ("expert",), Split.TEST, 0))
    (episode,), (record,) = reply.episodes, reply.records
    planned = handle_robot_plan(
        world.robot_planner, RobotPlanRequest(scenario=episode.scenario, motions=episode.motions)
    ).trajectory
    assert record.result.duration_s == pytest.approx(planned.duration_s)
    assert record.result.outcome is planned.outcome
    assert record.human_distance_min_m == pytest.approx(planned.human_distance_m.min(), abs=1e-6)


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("gnm", r"put gnm_large\.pth of github\.com/robodhruv/visualnav-transformer at .*gnm_large\.pth"),
        ("vint", r"vint\.pth"),
        ("nomad", r"nomad\.pth"),
        ("vid2sim", r'policy that learned among mesh-like people, at .*vid2sim: .*human_look = "mesh"'),
    ],
)
def test_what_was_trained_elsewhere_and_is_missing_is_named_with_its_place(world, name, said, tmp_path: Path):
    evaluator = make_evaluator(world, methods=named_methods(world, (name,), tmp_path))
    with pytest.raises(PolicyError, match=said) as caught:
        evaluator.driver(name)
    assert "\n" not in str(caught.value)
