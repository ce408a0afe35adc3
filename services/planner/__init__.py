"""The planners: where humans walk (`humans`) and how the expert drives (`expert`); `explain` says why it did so."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.planner.expert.config import ExpertConfig as ExpertConfig
    from readygo.services.planner.expert.config import expert_recipe as expert_recipe
    from readygo.services.planner.expert.handlers import RobotPlanner as RobotPlanner
    from readygo.services.planner.expert.handlers import handle_robot_plan as handle_robot_plan
    from readygo.services.planner.expert.interface import Decision as Decision
    from readygo.services.planner.expert.interface import Expert as Expert
    from readygo.services.planner.expert.interface import ExpertDriver as ExpertDriver
    from readygo.services.planner.humans.config import FamilyMix as FamilyMix
    from readygo.services.planner.humans.config import HumanPlannerConfig as HumanPlannerConfig
    from readygo.services.planner.humans.handlers import HumanPlanner as HumanPlanner
    from readygo.services.planner.humans.handlers import handle_human_plan as handle_human_plan
    from readygo.services.planner.scene_maps import SceneMaps as SceneMaps
else:
    _NAMES = {
        ".expert.config": (
            "ExpertConfig",
            "expert_recipe",
        ),
        ".expert.handlers": (
            "RobotPlanner",
            "handle_robot_plan",
        ),
        ".expert.interface": (
            "Decision",
            "Expert",
            "ExpertDriver",
        ),
        ".humans.config": (
            "FamilyMix",
            "HumanPlannerConfig",
        ),
        ".humans.handlers": (
            "HumanPlanner",
            "handle_human_plan",
        ),
        ".scene_maps": ("SceneMaps",),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
