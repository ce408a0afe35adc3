import pytest

from readygo.apps.commands import warm as command


def test_command_compiles_and_says_so(monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> None:
    done = []
    monkeypatch.setattr(command, "warm_all", lambda: done.append(True))
    command.warm(command.WarmOptions())
    assert done == [True]
    printed = capsys.readouterr()
    assert printed.err.startswith("Kernels are compiled (")
    assert printed.out == ""
