"""The planner on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import HumanPlanRequest, RobotPlanRequest
from readygo.services.planner.handlers import Planner, handle_human_plan, handle_robot_plan


def attach(bus: Bus, planner: Planner) -> None:
    """Serve `human-plan` and `robot-plan` on `bus`."""
    bus.serve("human-plan", HumanPlanRequest, partial(handle_human_plan, planner))
    bus.serve("robot-plan", RobotPlanRequest, partial(handle_robot_plan, planner))
