"""The evaluator: closed-loop success rates."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.evaluator.baselines.discrete import DiscretePlannerDriver as DiscretePlannerDriver
    from readygo.services.evaluator.baselines.goal_field import GoalField as GoalField
    from readygo.services.evaluator.baselines.social_force import SocialForceDriver as SocialForceDriver
    from readygo.services.evaluator.baselines.splat_nav import SplatMap as SplatMap
    from readygo.services.evaluator.baselines.splat_nav import SplatNavDriver as SplatNavDriver
    from readygo.services.evaluator.categories import Category as Category
    from readygo.services.evaluator.config import EvaluatorConfig as EvaluatorConfig
    from readygo.services.evaluator.custom_method import load_custom_method as load_custom_method
    from readygo.services.evaluator.custom_method import stated_training as stated_training
    from readygo.services.evaluator.drivers import EXPERT as EXPERT
    from readygo.services.evaluator.drivers import POLICY as POLICY
    from readygo.services.evaluator.drivers import STRAIGHT_LINE as STRAIGHT_LINE
    from readygo.services.evaluator.drivers import short_name as short_name
    from readygo.services.evaluator.episodes import MatchedEpisode as MatchedEpisode
    from readygo.services.evaluator.episodes import Simulate as Simulate
    from readygo.services.evaluator.episodes import Task as Task
    from readygo.services.evaluator.episodes import as_task as as_task
    from readygo.services.evaluator.eyes import Eyes as Eyes
    from readygo.services.evaluator.handlers import RENDERER as RENDERER
    from readygo.services.evaluator.handlers import Elsewhere as Elsewhere
    from readygo.services.evaluator.handlers import EvaluateReply as EvaluateReply
    from readygo.services.evaluator.handlers import EvaluateRequest as EvaluateRequest
    from readygo.services.evaluator.handlers import Evaluator as Evaluator
    from readygo.services.evaluator.handlers import MakeDriver as MakeDriver
    from readygo.services.evaluator.handlers import Report as Report
    from readygo.services.evaluator.handlers import drive as drive
    from readygo.services.evaluator.handlers import handle_evaluate as handle_evaluate
    from readygo.services.evaluator.keeper import Keeper as Keeper
    from readygo.services.evaluator.network_driver import NetworkDriver as NetworkDriver
    from readygo.services.evaluator.records import EpisodeRecord as EpisodeRecord
    from readygo.services.evaluator.records import RecordKey as RecordKey
    from readygo.services.evaluator.records import shown_record as shown_record
    from readygo.services.evaluator.records import summarize_records as summarize_records
    from readygo.services.evaluator.records import summary_mapping as summary_mapping
    from readygo.services.evaluator.records import summary_table as summary_table
    from readygo.services.evaluator.results import METHODS as METHODS
    from readygo.services.evaluator.results import Results as Results
    from readygo.services.evaluator.results import is_of as is_of
    from readygo.services.evaluator.results import open_results as open_results
    from readygo.services.evaluator.results import read_results as read_results
    from readygo.services.evaluator.scores import MEASURES as MEASURES
    from readygo.services.evaluator.scores import Comparison as Comparison
    from readygo.services.evaluator.scores import Group as Group
    from readygo.services.evaluator.scores import Measure as Measure
    from readygo.services.evaluator.scores import Score as Score
    from readygo.services.evaluator.scores import compare_all as compare_all
    from readygo.services.evaluator.scores import comparison_mapping as comparison_mapping
    from readygo.services.evaluator.scores import failure_counts as failure_counts
    from readygo.services.evaluator.scores import score_mapping as score_mapping
    from readygo.services.evaluator.scores import scores_of as scores_of
    from readygo.services.evaluator.service import attach as attach
else:
    _NAMES = {
        ".baselines.discrete": ("DiscretePlannerDriver",),
        ".baselines.goal_field": ("GoalField",),
        ".baselines.social_force": ("SocialForceDriver",),
        ".baselines.splat_nav": (
            "SplatMap",
            "SplatNavDriver",
        ),
        ".categories": ("Category",),
        ".config": ("EvaluatorConfig",),
        ".custom_method": ("load_custom_method", "stated_training"),
        ".drivers": (
            "EXPERT",
            "POLICY",
            "STRAIGHT_LINE",
            "short_name",
        ),
        ".episodes": (
            "MatchedEpisode",
            "Simulate",
            "Task",
            "as_task",
        ),
        ".eyes": ("Eyes",),
        ".handlers": (
            "Elsewhere",
            "EvaluateReply",
            "EvaluateRequest",
            "Evaluator",
            "MakeDriver",
            "RENDERER",
            "Report",
            "drive",
            "handle_evaluate",
        ),
        ".keeper": ("Keeper",),
        ".network_driver": ("NetworkDriver",),
        ".records": (
            "EpisodeRecord",
            "RecordKey",
            "shown_record",
            "summarize_records",
            "summary_mapping",
            "summary_table",
        ),
        ".results": (
            "METHODS",
            "Results",
            "is_of",
            "open_results",
            "read_results",
        ),
        ".scores": (
            "Comparison",
            "Group",
            "MEASURES",
            "Measure",
            "Score",
            "compare_all",
            "comparison_mapping",
            "failure_counts",
            "score_mapping",
            "scores_of",
        ),
        ".service": ("attach",),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
