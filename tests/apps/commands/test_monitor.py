from pathlib import Path

import pytest

from readygo.apps.commands import monitor as command
from readygo.apps.commands.monitor import MonitorOptions, monitor
from readygo.apps.fleet.options import JoinOptions
from readygo.common.bus.zenoh_bus import free_endpoint
from readygo.common.errors import BusError, RunError


def test_it_must_be_said_what_to_watch(tmp_path: Path) -> None:
    with pytest.raises(RunError, match="Name what to watch"):
        monitor(MonitorOptions())
    with pytest.raises(RunError, match="Name what to watch"):
        monitor(MonitorOptions(data=tmp_path, fleet=JoinOptions(connect="tcp/127.0.0.1:1")))
    with pytest.raises(RunError, match="--run RUN"):
        monitor(MonitorOptions(fleet=JoinOptions(connect="tcp/127.0.0.1:1")))
    with pytest.raises(BusError, match="No router answers"):
        monitor(MonitorOptions(fleet=JoinOptions(connect=free_endpoint(), run="run-a")))


def test_page_ends_at_ctrl_c_and_says_that_nothing_changed(data: Path, monkeypatch: pytest.MonkeyPatch, capsys) -> None:
    def stop() -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("readygo.apps.commands.monitor._wait", stop)
    monkeypatch.setattr("readygo.apps.commands.monitor.Screen", lambda *_, **__: _Screen())
    with pytest.raises(KeyboardInterrupt, match="as it was"):
        monitor(MonitorOptions(data=data, port=0))
    assert "http://127.0.0.1:4711/" in capsys.readouterr().err
    with pytest.raises(KeyboardInterrupt):
        monitor(MonitorOptions(data=data, port=0, host="0.0.0.0"))
    assert "/?token=" in capsys.readouterr().err, "other hosts are asked for a token"


class _Screen:
    port = 4711

    def close(self) -> None:
        pass


@pytest.mark.parametrize(
    ("host", "loopback", "named"),
    [
        ("127.0.0.1", True, "127.0.0.1"),
        ("::1", True, "[::1]"),
        ("localhost", True, "localhost"),
        ("0.0.0.0", False, "0.0.0.0"),
        ("lab", False, "lab"),
    ],
)
def test_addresses_are_told_apart(host: str, loopback: bool, named: str) -> None:
    assert (command._is_loopback(host), command._url_host(host)) == (loopback, named)


@pytest.mark.parametrize(
    ("variables", "desktop"), [({}, False), ({"DISPLAY": ":0"}, True), ({"WAYLAND_DISPLAY": "w"}, True)]
)
def test_browser_is_opened_where_there_is_a_desktop_and_somebody_asks_for_it(
    variables: dict[str, str], desktop: bool, monkeypatch: pytest.MonkeyPatch, data: Path, capsys
) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    for name, value in variables.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setattr(command.sys, "platform", "linux")
    opened: list[str] = []
    screens: list[dict[str, object]] = []
    monkeypatch.setattr(command.webbrowser, "open", opened.append)
    monkeypatch.setattr(command, "Screen", lambda *_, **more: screens.append(more) or _Screen())
    monkeypatch.setattr(command, "_wait", lambda: None)
    monkeypatch.setenv("READYGO_MONITOR_TOKEN", "mine")
    monitor(MonitorOptions(data=data, port=0, open=True))
    monitor(MonitorOptions(data=data, port=0, open=False))
    monitor(MonitorOptions(data=data, port=7, host="::", open=True))
    assert opened == (["http://127.0.0.1:4711/", "http://[::]:4711/?token=mine"] if desktop else [])
    assert [(one["host"], one["port"], one["token"]) for one in screens] == [
        ("127.0.0.1", 0, ""), ("127.0.0.1", 0, ""), ("::", 7, "mine")
    ]  # fmt: skip
