"""The planners: where humans walk (`humans`) and how the expert drives (`expert`); `explain` says why it did so."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.planner.expert.config import CELL_MARGIN_M as CELL_MARGIN_M
    from readygo.services.planner.expert.config import ExpertConfig as ExpertConfig
    from readygo.services.planner.expert.config import expert_recipe as expert_recipe
    from readygo.services.planner.expert.handlers import RobotPlanner as RobotPlanner
    from readygo.services.planner.expert.handlers import drive as drive
    from readygo.services.planner.expert.handlers import handle_robot_plan as handle_robot_plan
    from readygo.services.planner.expert.interface import Expert as Expert
    from readygo.services.planner.expert.interface import ExpertDriver as ExpertDriver
    from readygo.services.planner.expert.perceiving import PerceivingDriver as PerceivingDriver
    from readygo.services.planner.expert.perceiving import TrackedExpert as TrackedExpert
    from readygo.services.planner.expert.tracked import TrackedHumans as TrackedHumans
    from readygo.services.planner.explain.journal import DrivenRun as DrivenRun
    from readygo.services.planner.explain.journal import run_beside_expert as run_beside_expert
    from readygo.services.planner.explain.journal import run_with_journal as run_with_journal
    from readygo.services.planner.explain.numbers import Numbers as Numbers
    from readygo.services.planner.explain.numbers import run_numbers as run_numbers
    from readygo.services.planner.explain.numbers import scenario_numbers as scenario_numbers
    from readygo.services.planner.explain.picture import Look as Look
    from readygo.services.planner.explain.picture import draw_episode as draw_episode
    from readygo.services.planner.explain.picture import draw_run as draw_run
    from readygo.services.planner.explain.picture import draw_ways as draw_ways
    from readygo.services.planner.explain.picture import episode_view as episode_view
    from readygo.services.planner.explain.picture_layers import draw_knowledge as draw_knowledge
    from readygo.services.planner.explain.picture_layers import draw_superseded as draw_superseded
    from readygo.services.planner.humans.config import HumanPlannerConfig as HumanPlannerConfig
    from readygo.services.planner.humans.handlers import HumanPlanner as HumanPlanner
    from readygo.services.planner.humans.handlers import handle_human_plan as handle_human_plan
    from readygo.services.planner.humans.mixes import MIXES as MIXES
    from readygo.services.planner.humans.mixes import MixName as MixName
    from readygo.services.planner.humans.reactive import ReactiveHumans as ReactiveHumans
    from readygo.services.planner.humans.reactive import ReactiveSimulation as ReactiveSimulation
    from readygo.services.planner.humans.scenario_file import ScenarioFile as ScenarioFile
    from readygo.services.planner.humans.scenario_file import load_scenarios as load_scenarios
    from readygo.services.planner.humans.scenario_file import parse_scenarios as parse_scenarios
    from readygo.services.planner.humans.scenario_file import read_text as read_text
    from readygo.services.planner.humans.scenario_file import save_scenarios as save_scenarios
    from readygo.services.planner.humans.scenario_file import text_hash as text_hash
    from readygo.services.planner.scene_maps import PlanningMaps as PlanningMaps
    from readygo.services.planner.service import attach as attach
else:
    _NAMES = {
        ".expert.config": (
            "CELL_MARGIN_M",
            "ExpertConfig",
            "expert_recipe",
        ),
        ".expert.handlers": (
            "RobotPlanner",
            "drive",
            "handle_robot_plan",
        ),
        ".expert.interface": (
            "Expert",
            "ExpertDriver",
        ),
        ".expert.perceiving": (
            "PerceivingDriver",
            "TrackedExpert",
        ),
        ".expert.tracked": ("TrackedHumans",),
        ".explain.journal": (
            "DrivenRun",
            "run_beside_expert",
            "run_with_journal",
        ),
        ".explain.numbers": (
            "Numbers",
            "run_numbers",
            "scenario_numbers",
        ),
        ".explain.picture": (
            "Look",
            "draw_episode",
            "draw_run",
            "draw_ways",
            "episode_view",
        ),
        ".explain.picture_layers": (
            "draw_knowledge",
            "draw_superseded",
        ),
        ".humans.config": ("HumanPlannerConfig",),
        ".humans.handlers": (
            "HumanPlanner",
            "handle_human_plan",
        ),
        ".humans.mixes": (
            "MIXES",
            "MixName",
        ),
        ".humans.reactive": (
            "ReactiveHumans",
            "ReactiveSimulation",
        ),
        ".humans.scenario_file": (
            "ScenarioFile",
            "load_scenarios",
            "parse_scenarios",
            "read_text",
            "save_scenarios",
            "text_hash",
        ),
        ".scene_maps": ("PlanningMaps",),
        ".service": ("attach",),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
