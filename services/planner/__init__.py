"""The planners: where humans walk (`humans`) and how the expert drives (`expert`); `explain` says why it did so."""

from readygo.services.planner.expert.config import ExpertConfig, expert_recipe
from readygo.services.planner.expert.handlers import RobotPlanner, handle_robot_plan
from readygo.services.planner.expert.interface import Decision, Expert
from readygo.services.planner.humans.config import FamilyMix, HumanPlannerConfig
from readygo.services.planner.humans.handlers import HumanPlanner, handle_human_plan
from readygo.services.planner.scene_maps import SceneMaps

__all__ = [
    "Decision",
    "Expert",
    "ExpertConfig",
    "FamilyMix",
    "HumanPlanner",
    "HumanPlannerConfig",
    "RobotPlanner",
    "SceneMaps",
    "expert_recipe",
    "handle_human_plan",
    "handle_robot_plan",
]
