"""A run that learns with a few tiny episodes, most of them driven by a policy of random numbers."""

import dataclasses
from pathlib import Path

import pytest

from readygo.apps.fleet.run import run_in_process
from readygo.apps.learn.config import LearnConfig
from readygo.apps.learn.plan import Budget, LearnPlan, learn_settings, make_plan
from readygo.common.episode import EpisodeConfig
from readygo.common.messages import PolicyRef
from readygo.runs.policy import policy_refs
from readygo.services.coordinator import BlobStore, Ledger
from tests.common.policy.artifacts import ROBOT, write_policy

EPISODES = 6


@pytest.fixture(scope="session")
def tiny(tmp_path_factory: pytest.TempPathFactory) -> LearnPlan:
    out = tmp_path_factory.mktemp("tiny") / "run"
    episode = EpisodeConfig(goal_distance_min_m=1.5, goal_distance_max_m=2.5, time_limit_s=4.0)
    config = dataclasses.replace(learn_settings(None, None), robot=ROBOT, episode=episode)
    budget = Budget(minutes=1.0)
    plan = make_plan(("embedded",), out, config, LearnConfig(), budget, avatars=None, seed=0)
    write_policy(plan.policy)
    place = plan.places[0]
    with place.folder.lock():
        place.folder.save(place.spec, EPISODES)
        _offer(plan.policy, place.folder.ledger, place.folder.blobs, plan)
        run_in_process(place.folder, lambda status: None)
    return plan


def _offer(policy: Path, ledger: Path, blobs: Path, plan: LearnPlan) -> None:
    store, book = BlobStore(blobs), Ledger(ledger, plan.places[0].spec.stages)
    files = policy_refs(policy)
    for file in files:
        store.put((policy / file.path).read_bytes())
    book.policies.offer(PolicyRef(path="", files=files, mix=plan.learn.mix), 0)
    book.close()
