import subprocess
import sys
import weakref

import pytest

from readygo.common import left_open
from readygo.common.left_open import close_all, note_open

INTERRUPTED = """
import sys
from readygo import __main__, commands
from readygo.apps.cli import CliCommand
from dataclasses import dataclass
from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.messages import topics

@dataclass
class NoOptions:
    pass

def hear(options: NoOptions) -> None:
    router = Router(free_endpoint())
    bus = ZenohBus(router.endpoint, "run")
    bus.subscribe(topics.PROGRESS, print)
    foreign = ForeignSession(router.endpoint)
    foreign.hear("odom", print)
    raise KeyboardInterrupt

commands.COMMANDS = {"hear": CliCommand("__main__:hear", "hears")}
sys.argv = ["readygo", "hear"]
__main__.main()
"""


def test_command_that_is_interrupted_before_it_closes_its_sessions_ends() -> None:
    run = subprocess.run([sys.executable, "-c", INTERRUPTED], capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode == 130
    assert run.stderr.startswith("readygo: stopped;")


class Session:
    def __init__(self, *, fails: bool = False) -> None:
        self.closed, self.fails = 0, fails

    def close(self) -> None:
        self.closed += 1
        if self.fails:
            raise OSError("the network is down")


def test_all_that_is_open_is_closed_once(caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch) -> None:
    # Other tests' sessions stay open.
    monkeypatch.setattr(left_open, "_OPEN", weakref.WeakSet())
    sessions = [Session(), Session(fails=True), Session()]
    for session in sessions:
        note_open(session)
    close_all()
    close_all()
    assert [session.closed for session in sessions] == [1, 1, 1]
    assert "the network is down" in caplog.text
