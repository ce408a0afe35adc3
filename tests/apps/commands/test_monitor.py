from pathlib import Path

import pytest

from readygo.apps.commands.monitor import monitor
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.errors import BusError, RunError


def test_it_must_be_said_what_to_watch(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="Name what to watch"):
        monitor()
    with pytest.raises(RunError, match="Name what to watch"):
        monitor(tmp_path, connect="tcp/127.0.0.1:1")
    with pytest.raises(RunError, match="--run RUN"):
        monitor(connect="tcp/127.0.0.1:1")
    with pytest.raises(BusError, match="No router answers"):
        monitor(connect=free_endpoint(), run="run-a")


def test_page_ends_at_ctrl_c_and_says_that_nothing_changed(data: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("readygo.apps.commands.monitor._wait", stop)
    monkeypatch.setattr("readygo.apps.commands.monitor.Screen", lambda *_, **__: _Screen())
    with pytest.raises(KeyboardInterrupt, match="as it was"):
        monitor(data, port=0)
    assert "http://127.0.0.1:4711/" in capsys.readouterr().err
    with pytest.raises(KeyboardInterrupt):
        monitor(data, port=0, host="0.0.0.0")
    assert "/?token=" in capsys.readouterr().err, "other hosts are asked for a token"


class _Screen:
    port = 4711

    def close(self) -> None:
        pass
