"""Logs of a process: text lines, or JSON lines with run, worker, stage, episode and attempt."""

import json
import logging
import sys
import threading
import time
from types import TracebackType
from typing import Any, Literal

from readygo.common.documents import parse_json
from readygo.common.fleet.at_work import AT_WORK
from readygo.common.printable import PlainLines, strip_controls

LogFormat = Literal["text", "json"]
_TEXT = "%(asctime)s %(name)s %(levelname)s %(message)s"


class JsonLines(logging.Formatter):
    """Formatter of one JSON object per line: time, level, logger, message, process, and the thread's current work."""

    def __init__(self, **whose: str) -> None:
        super().__init__()
        self._whose = {name: value for name, value in whose.items() if value}

    def format(self, record: logging.LogRecord) -> str:
        """Format a record as one line."""
        line: dict[str, Any] = {
            "time": time.strftime("%Y-%m-%dT%H:%M:%S", time.gmtime(record.created)) + f".{int(record.msecs):03d}Z",
            "level": record.levelname.lower(),
            "logger": record.name,
            "message": record.getMessage(),
            **self._whose,
        }
        if at_work := AT_WORK.get():
            line |= {"stage": at_work.stage, "episode": at_work.episode, "attempt": at_work.attempt}
        if record.exc_info:
            line["traceback"] = self.formatException(record.exc_info)
        return strip_controls(json.dumps(line, ensure_ascii=False))


def begin_logging(log_format: LogFormat, *, run: str, role: str, worker: str) -> None:
    """Log to standard error from now on.

    Args:
        log_format: "text", or "json": then all output is JSON lines, including tracebacks and warnings.
        run: Name of the run.
        role: Role of the process.
        worker: Name of the process.
    """
    handler = logging.StreamHandler(sys.stderr)
    if log_format == "json":
        handler.setFormatter(JsonLines(run=run, role=role, worker=worker))
        logging.captureWarnings(True)
        sys.excepthook = _log_uncaught
        threading.excepthook = lambda args: _log_uncaught(args.exc_type, args.exc_value, args.exc_traceback)
    else:
        handler.setFormatter(PlainLines(_TEXT))
    logging.basicConfig(level=logging.INFO, handlers=[handler])


def message_of(line: str) -> str:
    """The message of a log line of either format."""
    try:
        return str(parse_json(line)["message"])
    except (ValueError, KeyError, TypeError):
        return line


def _log_uncaught(kind: type[BaseException], error: BaseException | None, traceback: TracebackType | None) -> None:
    info = (kind, error or kind(), traceback)
    logging.getLogger("readygo").critical("%s: %s", kind.__name__, error, exc_info=info)
