import sys
from pathlib import Path

import pytest

from readygo.apps.monitor import beside
from readygo.common.errors import RunError


def test_missing_viewer_is_said_before_the_run_begins(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside.importlib.util, "find_spec", lambda _: None)
    with pytest.raises(RunError, match="--watch needs viser"), beside.show_page(Path("x"), lambda: True):
        pass


def test_page_begins_with_the_run_and_ends_with_its_command(monkeypatch: pytest.MonkeyPatch) -> None:
    begun: list[list[str]] = []
    ended: list[str] = []

    class Process:
        def __init__(self, command: list[str], **_: object) -> None:
            begun.append(command)

        def kill(self) -> None:
            ended.append("kill")

        def wait(self) -> None:
            ended.append("wait")

    monkeypatch.setattr(beside, "check_viewer", lambda: None)
    monkeypatch.setattr(beside, "POLL_S", 0.01)
    monkeypatch.setattr(beside.subprocess, "Popen", Process)
    ready: list[bool] = []
    with beside.show_page(Path("out"), lambda: bool(ready), Path("certs")):
        assert not begun
        ready.append(True)
        while not begun:
            pass
    assert begun[0][:5] == [sys.executable, "-m", "readygo", "monitor", "out"]
    assert begun[0][-2:] == ["--certs", "certs"]
    assert ended == ["kill", "wait"]


def test_run_that_never_begins_has_no_page(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(beside, "check_viewer", lambda: None)
    monkeypatch.setattr(beside.subprocess, "Popen", lambda *_, **__: pytest.fail("there is nothing to show"))
    with beside.show_page(Path("out"), lambda: False):
        pass
