import json
import logging
import sys
import threading
from collections.abc import Iterator
from typing import Literal

import pytest

from readygo.apps.observe.logs import begin_logging, message_of
from readygo.common.fleet.at_work import working


@pytest.fixture
def logging_as_before() -> Iterator[None]:
    root = logging.getLogger()
    before, hooks = (root.handlers[:], root.level), (sys.excepthook, threading.excepthook)
    yield
    logging.captureWarnings(False)
    root.handlers, root.level = before
    sys.excepthook, threading.excepthook = hooks


@pytest.mark.usefixtures("logging_as_before")
def test_log_lines_name_the_episode(capsys: pytest.CaptureFixture[str]) -> None:
    # Those of pytest itself.
    logging.getLogger().handlers = []
    begin_logging("json", run="run-test", role="all", worker="all0")
    with working(stage="draw", episode="train-7-000003", attempt=2):
        logging.getLogger("elsewhere").warning("by the %s", "way")
    line = json.loads(capsys.readouterr().err)
    assert {key: line[key] for key in ("level", "message", "run", "worker", "stage", "episode", "attempt")} == {
        "level": "warning",
        "message": "by the way",
        "run": "run-test",
        "worker": "all0",
        "stage": "draw",
        "episode": "train-7-000003",
        "attempt": 2,
    }


@pytest.mark.usefixtures("logging_as_before")
@pytest.mark.parametrize("log_format", ["json", "text"])
def test_log_of_what_a_peer_said_steers_no_terminal(
    log_format: Literal["json", "text"], capsys: pytest.CaptureFixture[str]
) -> None:
    logging.getLogger().handlers = []
    begin_logging(log_format, run="run-test", role="all", worker="all0")
    logging.getLogger("elsewhere").warning("%s", "\x1b]0;title\x07\x9b2J")
    said = capsys.readouterr().err
    assert "0;title" in said
    assert not {"\x1b", "\x07", "\x9b"} & set(said)


def test_last_words_are_read_of_both_formats() -> None:
    assert message_of('{"level": "critical", "message": "the disk is full"}') == "the disk is full"
    assert message_of("readygo: the disk is full") == "readygo: the disk is full"
    assert message_of('["no log"]') == '["no log"]'
