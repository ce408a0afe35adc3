import pytest

from readygo.apps.commands import warm as command


@pytest.mark.parametrize("states", [False, True])
def test_command_compiles_and_says_so(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str], states: bool
) -> None:
    done = []
    monkeypatch.setattr(command, "warm_all", lambda: done.append("all"))
    monkeypatch.setattr(command, "warm_states", lambda: done.append("states"))
    command.warm(command.WarmOptions(states=states))
    assert done == ["all", "states"][: 1 + states]
    printed = capsys.readouterr()
    assert printed.err.startswith("Kernels are compiled (")
    assert printed.out == ""
