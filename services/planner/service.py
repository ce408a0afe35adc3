"""The planner on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import topics
from readygo.services.planner.handlers import Planner, handle_human_plan, handle_robot_plan


def attach(bus: Bus, planner: Planner) -> None:
    """Plan humans and robots for those who ask."""
    bus.serve(topics.HUMAN_PLAN, partial(handle_human_plan, planner))
    bus.serve(topics.ROBOT_PLAN, partial(handle_robot_plan, planner))
