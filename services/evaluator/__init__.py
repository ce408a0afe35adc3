"""The evaluator: closed-loop success rates."""

from readygo.services.evaluator.config import EvaluatorConfig
from readygo.services.evaluator.drivers import Method
from readygo.services.evaluator.episodes import Task
from readygo.services.evaluator.handlers import EvaluateReply, EvaluateRequest, Evaluator, handle_evaluate
from readygo.services.evaluator.records import (
    EpisodeRecord,
    read_results,
    summarize_records,
    summary_mapping,
    summary_table,
    write_results,
)

__all__ = [
    "EpisodeRecord",
    "EvaluateReply",
    "EvaluateRequest",
    "Evaluator",
    "EvaluatorConfig",
    "Method",
    "Task",
    "handle_evaluate",
    "read_results",
    "summarize_records",
    "summary_mapping",
    "summary_table",
    "write_results",
]
