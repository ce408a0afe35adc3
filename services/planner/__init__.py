"""The planners: where humans walk and how the expert drives."""

from services.planner.config import ExpertConfig, FamilyMix, HumanPlannerConfig
from services.planner.expert import Decision, RobotExpert
from services.planner.handlers import Planner, handle_human_plan, handle_robot_plan

__all__ = [
    "Decision",
    "ExpertConfig",
    "FamilyMix",
    "HumanPlannerConfig",
    "Planner",
    "RobotExpert",
    "handle_human_plan",
    "handle_robot_plan",
]
