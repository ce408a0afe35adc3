"""The planners: where humans walk and how the expert drives."""

from services.planner.config import FamilyMix, HumanPlannerConfig
from services.planner.expert.config import ExpertConfig, expert_recipe
from services.planner.expert.interface import Decision, Expert
from services.planner.handlers import Planner, handle_human_plan, handle_robot_plan

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
