"""An evaluation of a policy of random numbers in the embedded scene: two short episodes of each task."""

from pathlib import Path
from types import SimpleNamespace

import pytest

from readygo.apps.evaluation.replay import Replays
from readygo.common.messages import Split
from readygo.common.policy import load_policy
from readygo.runs.config import load_run_config
from readygo.runs.evaluation import evaluation_settings, evaluation_world, make_evaluator, make_request
from readygo.services.evaluator import handle_evaluate, open_results
from tests.common.policy.artifacts import ROBOT, write_policy

CONFIG = "[episode]\ngoal_distance_max_m = 4.0\ntime_limit_s = 3.0\n"


@pytest.fixture(scope="session")
def evaluated(tmp_path_factory: pytest.TempPathFactory):
    """The evaluation, with its folder open."""
    out: Path = tmp_path_factory.mktemp("evaluated")
    policy = write_policy(out / "policy")
    (out / "run.toml").write_text(CONFIG)
    world = evaluation_world("embedded", load_run_config(out / "run.toml", ROBOT), avatars=None, seed=0)
    request = make_request(2, ("static", "dynamic"), ("policy", "straight-line"), Split.TEST, 0)
    renderer = world.renderer()
    evaluator = make_evaluator(world, renderer=renderer, policy=load_policy(policy))
    settings = evaluation_settings(world, request, policy="ab", camera="policy")
    with open_results(out / "results", settings) as results:
        reply = handle_evaluate(evaluator, request, results=results)
        replays = Replays(world, results, reply.episodes, renderer, evaluator.simulation)
        yield SimpleNamespace(
            folder=out / "results",
            policy=policy,
            config=out / "run.toml",
            request=request,
            reply=reply,
            replays=replays,
        )
