"""The evaluator: closed-loop success rates."""

from readygo.services.evaluator.config import EvaluatorConfig
from readygo.services.evaluator.drivers import Method
from readygo.services.evaluator.episodes import MatchedEpisode, Task
from readygo.services.evaluator.handlers import EvaluateReply, EvaluateRequest, Evaluator, handle_evaluate
from readygo.services.evaluator.records import (
    EpisodeRecord,
    RecordKey,
    summarize_records,
    summary_mapping,
    summary_table,
)
from readygo.services.evaluator.results import Results, is_of, open_results

__all__ = [
    "EpisodeRecord",
    "EvaluateReply",
    "EvaluateRequest",
    "Evaluator",
    "EvaluatorConfig",
    "MatchedEpisode",
    "Method",
    "RecordKey",
    "Results",
    "Task",
    "handle_evaluate",
    "is_of",
    "open_results",
    "summarize_records",
    "summary_mapping",
    "summary_table",
]
