"""The planners on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import topics
from readygo.services.planner.expert.handlers import RobotPlanner, handle_robot_plan
from readygo.services.planner.humans.handlers import HumanPlanner, handle_human_plan


def attach(bus: Bus, humans: HumanPlanner, robot: RobotPlanner) -> None:
    """Serve `human-plan` and `robot-plan` on `bus`."""
    bus.serve(topics.HUMAN_PLAN, partial(handle_human_plan, humans))
    bus.serve(topics.ROBOT_PLAN, partial(handle_robot_plan, robot))
