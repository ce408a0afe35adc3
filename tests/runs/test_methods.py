import dataclasses
from collections import Counter
from pathlib import Path

import pytest

from readygo.common.camera import CameraConfig
from readygo.common.errors import PolicyError
from readygo.common.messages import Outcome, RobotPlanRequest, Split
from readygo.common.policy import load_policy
from readygo.runs.config import load_run_config
from readygo.runs.evaluation import evaluation_world, make_evaluator, make_request
from readygo.runs.methods import (
    BLIND,
    RL,
    named_methods,
    needs_renderer,
    network_file,
    network_of,
    other_policies,
    state_policies,
)
from readygo.services.evaluator import handle_evaluate
from readygo.services.planner import handle_robot_plan
from tests.common.policy.artifacts import ROBOT, write_policy
from tests.common.state_policy.state_policies import write_state_policy


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


def test_experts_of_other_recipes_see_nobody_or_know_all(world):
    drivers = {
        name: make_evaluator(world).driver(name) for name in ("expert-blind", "expert-oracle", "expert-paper", "expert")
    }
    request = make_request(4, ("dynamic",), tuple(drivers), Split.TEST, 0)
    records = handle_evaluate(make_evaluator(world), request).records
    reached = Counter(record.method for record in records if record.result.outcome is Outcome.SUCCESS)
    assert reached["expert-blind"] < reached["expert-oracle"] == 4
    alone = [
        r
        for r in handle_evaluate(
            make_evaluator(world), make_request(1, ("static",), ("expert", "expert-blind"), Split.TEST, 0)
        ).records
    ]
    assert alone[0].result == alone[1].result, "nobody to see"


@pytest.mark.parametrize(
    ("name", "said"),
    [
        ("gnm", r"put gnm_large\.pth of github\.com/robodhruv/visualnav-transformer at .*gnm_large\.pth"),
        ("gnm/fine-tuned", r"at .*/gnm/fine-tuned/gnm_large\.pth"),
        ("vint", r"vint\.pth"),
        ("nomad", r"nomad\.pth"),
        ("perceive-and-plan", r"perceive-and-plan: .*perception holds no perception\.toml"),
        ("perceive-and-act", r"perceive-and-act needs a policy at .*rl: readygo rl SCENE --out .*rl"),
        ("vid2sim", r'policy that learned among mesh-like people, at .*vid2sim: .*human_look = "mesh"'),
    ],
)
def test_what_was_trained_elsewhere_and_is_missing_is_named_with_its_place(world, name, said, tmp_path: Path):
    evaluator = make_evaluator(world, methods=named_methods(world, (name,), tmp_path))
    with pytest.raises(PolicyError, match=said) as caught:
        evaluator.driver(name)
    assert "\n" not in str(caught.value)


def test_networks_of_several_weights_are_named_by_their_folders(tmp_path: Path):
    names = ("gnm", "nomad/zero-shot/0", "mine/gnm", "gnm/a.py:A", "gnm2")
    assert [network_of(name) for name in names] == ["gnm", "nomad", "", "", ""]
    assert network_file("gnm", tmp_path) == tmp_path / "gnm_large.pth"
    assert network_file("nomad/zero-shot/0", tmp_path) == tmp_path / "nomad" / "zero-shot" / "0" / "nomad.pth"


def test_policies_are_found_by_the_names_of_their_folders_or_runs(tmp_path: Path):
    flat, run = write_policy(tmp_path / "flat"), write_policy(tmp_path / "run" / "policy")
    (tmp_path / "empty").mkdir()
    write_policy(tmp_path / "expert")
    write_policy(tmp_path / "gnm" / "0")
    asked = ("policy", "expert", "gnm", "gnm/0", "json:loads", "flat", "run", "empty", "nowhere")
    assert other_policies(asked, tmp_path) == {"flat": flat, "run": run}


def test_further_policy_drives_as_it_does_when_it_is_the_one_at_hand(tmp_path: Path):
    folder = write_policy(tmp_path / "other")
    config = load_run_config(None, ROBOT)
    short = dataclasses.replace(config.episode, goal_distance_max_m=4.0, time_limit_s=3.0)
    world = evaluation_world("embedded", dataclasses.replace(config, episode=short), avatars=None, seed=0)
    request = make_request(1, ("static",), ("policy", "other"), Split.TEST, 0, control_hz=4.0)
    methods = named_methods(world, request.methods, tmp_path, request.hold_steps(world.config.robot.clock))
    evaluator = make_evaluator(world, renderer=world.renderer(), policy=load_policy(folder), methods=methods)
    first, second = handle_evaluate(evaluator, request).records
    assert second.method == "other"
    assert dataclasses.replace(second, method="policy") == first
    larger = dataclasses.replace(evaluator.robot, camera=CameraConfig())
    elsewhere = dataclasses.replace(evaluator, policy=None, robot=larger)
    with pytest.raises(PolicyError, match="The method other: The policy was trained with another camera"):
        elsewhere.driver("other")


def test_state_policies_drive_without_a_renderer(world, tmp_path: Path):
    with pytest.raises(PolicyError, match="readygo rl"):
        make_evaluator(world, methods=named_methods(world, (RL,), tmp_path)).driver(RL)
    rl, other = write_state_policy(tmp_path / RL), write_state_policy(tmp_path / "other")
    assert state_policies((RL, "other", "expert", "nowhere"), tmp_path) == {RL: rl, "other": other}
    assert other_policies((RL, "other"), tmp_path) == {}
    assert not needs_renderer((RL, "other", "expert"), tmp_path)
    assert needs_renderer(("nowhere",), tmp_path)
    request = make_request(1, ("static", "dynamic"), (RL, "other"), Split.TEST, 0)
    evaluator = make_evaluator(world, methods=named_methods(world, request.methods, tmp_path))
    records = handle_evaluate(evaluator, request).records
    assert [record.method for record in records] == [RL, "other"] * 2
    assert all(record.reason == "" for record in records)
    slower = dataclasses.replace(world.config.robot, v_max_mps=0.5)
    with pytest.raises(PolicyError, match="another robot"):
        dataclasses.replace(evaluator, robot=slower).driver(RL)
