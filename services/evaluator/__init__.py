"""The evaluator: closed-loop success rates."""

from services.evaluator.config import EvaluatorConfig
from services.evaluator.drivers import Method
from services.evaluator.episodes import Task
from services.evaluator.handlers import EvaluateReply, EvaluateRequest, Evaluator, handle_evaluate
from services.evaluator.records import EpisodeRecord, summary_mapping, summary_table, write_results

__all__ = [
    "EpisodeRecord",
    "EvaluateReply",
    "EvaluateRequest",
    "Evaluator",
    "EvaluatorConfig",
    "Method",
    "Task",
    "handle_evaluate",
    "summary_mapping",
    "summary_table",
    "write_results",
]
