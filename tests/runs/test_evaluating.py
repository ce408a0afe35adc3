"""A worker's side of an evaluation; that its records are those of one process is in tests/apps/fleet."""

from pathlib import Path

import pytest

from readygo.apps.fleet.evaluation import make_plan
from readygo.common.bus import InProcessBus
from readygo.common.errors import PolicyError, RunError
from readygo.common.messages import ClaimReply, ClaimStatus, DrivesReply, EpisodeKey, Split, topics
from readygo.runs.config import RunConfig
from readygo.runs.evaluating import evaluation_work
from readygo.runs.evaluation import evaluation_world, make_request


@pytest.fixture(scope="module")
def world():
    return evaluation_world("embedded", RunConfig(), avatars=None, seed=0)


def bus_of(*methods: str, hashes: dict[str, str] | None = None) -> InProcessBus:
    request = make_request(1, ("static",), methods, Split.TEST, 0)
    plan = make_plan(request, camera="policy", lockstep=8, checkpoints=Path("none"), method_hashes=hashes or {})
    bus = InProcessBus()
    bus.serve(topics.EVALUATION_PLAN, lambda _: plan)
    return bus


def test_methods_that_cannot_drive_here_are_said_before_any_work(world) -> None:
    with pytest.raises(PolicyError, match="No policy is given"):
        evaluation_work(world, bus_of("policy"))
    with pytest.raises(RunError, match="is not on this machine"):
        evaluation_work(world, bus_of("gnm", hashes={"gnm": "ab" * 32}))


def test_episode_of_which_nothing_is_missing_is_not_driven(world) -> None:
    bus = bus_of("straight-line")
    bus.serve(topics.EVALUATION_DRIVES, lambda _: DrivesReply(drives=()))
    work = evaluation_work(world, bus)
    episode = EpisodeKey(seed=0, split=Split.TEST, index=0)
    assert work(ClaimReply(status=ClaimStatus.LEASE, episode=episode, attempt=1), {}) is None
