"""The keeper on a bus."""

from readygo.common.bus import InProcessBus
from readygo.common.messages import DrivesReply, DrivesRequest, EvaluationPlanRequest, topics
from readygo.services.evaluator.service import attach
from tests.services.evaluator.test_keeper import PLAN, REQUEST, commits, keeper  # noqa: F401


def test_workers_hear_the_plan_and_what_is_missing(keeper) -> None:  # noqa: F811
    bus = InProcessBus()
    attach(bus, keeper)
    assert bus.request(topics.EVALUATION_PLAN, EvaluationPlanRequest()) == PLAN
    reply = bus.request(topics.EVALUATION_DRIVES, DrivesRequest(index=5, attempt=1))
    assert isinstance(reply, DrivesReply)
    assert {drive.method for drive in reply.drives} == set(REQUEST.methods)
