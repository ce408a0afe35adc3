"""The planners: where humans walk and how the expert drives."""

from readygo.services.planner.config import FamilyMix, HumanPlannerConfig
from readygo.services.planner.expert.config import ExpertConfig, expert_recipe
from readygo.services.planner.expert.interface import Decision, Expert
from readygo.services.planner.handlers import Planner, handle_human_plan, handle_robot_plan

__all__ = [
    "Decision",
    "Expert",
    "ExpertConfig",
    "FamilyMix",
    "HumanPlannerConfig",
    "Planner",
    "expert_recipe",
    "handle_human_plan",
    "handle_robot_plan",
]
