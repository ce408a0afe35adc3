"""The evaluator: closed-loop success rates."""

from readygo.services.evaluator.categories import Category
from readygo.services.evaluator.config import EvaluatorConfig
from readygo.services.evaluator.drivers import EXPERT, POLICY, STRAIGHT_LINE, short_name
from readygo.services.evaluator.episodes import MatchedEpisode, Simulate, Task
from readygo.services.evaluator.handlers import EvaluateReply, EvaluateRequest, Evaluator, MakeDriver, handle_evaluate
from readygo.services.evaluator.records import (
    EpisodeRecord,
    RecordKey,
    shown_record,
    summarize_records,
    summary_mapping,
    summary_table,
)
from readygo.services.evaluator.results import Results, is_of, open_results, read_results

__all__ = [
    "Category",
    "EXPERT",
    "EpisodeRecord",
    "EvaluateReply",
    "EvaluateRequest",
    "Evaluator",
    "EvaluatorConfig",
    "MakeDriver",
    "MatchedEpisode",
    "POLICY",
    "RecordKey",
    "Results",
    "STRAIGHT_LINE",
    "Simulate",
    "Task",
    "handle_evaluate",
    "is_of",
    "open_results",
    "read_results",
    "short_name",
    "shown_record",
    "summarize_records",
    "summary_mapping",
    "summary_table",
]
