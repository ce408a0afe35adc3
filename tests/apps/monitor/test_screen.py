"""The page as browsers get it; the last tests open it in a real one."""

import contextlib
import http.client
import os
import shutil
import tempfile
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from readygo.apps.monitor.screen import Screen
from readygo.apps.monitor.subject import Subject
from readygo.common.bus import InProcessBus
from readygo.common.errors import RunError
from readygo.common.messages import topics
from tests.apps.monitor.test_page import house
from tests.apps.monitor.test_watch import renderer, states
from tests.apps.monitor.watched import status, tell_status, watched
from tests.waiting import wait_for

pytest.importorskip("viser", reason="viser is not installed: readygo[monitor]")
OF_VISER = "computeBoundingSphere"
"""viser 1.1.1 says this of any Gaussians, alone on a page as well."""
CHROMIUM = shutil.which("chromium")
SOFTWARE = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


@pytest.fixture
def live() -> Iterator[tuple[Screen, Subject, InProcessBus]]:
    run, watch = watched()
    subject = Subject("flat")
    subject.watch, subject.house = watch, house()
    screen = Screen([subject], host="127.0.0.1", port=0)
    yield screen, subject, run
    screen.close()


@pytest.fixture
def browser() -> Iterator[Any]:
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    if CHROMIUM is None:
        pytest.skip("chromium is not installed")
    with playwright.sync_playwright() as library:
        chromium = library.chromium.launch(executable_path=CHROMIUM, args=SOFTWARE)
        yield chromium
        chromium.close()


def test_page_is_served_and_ends(data: Path) -> None:
    screen = Screen([Subject("data", data=data)], host="127.0.0.1", port=0)
    assert screen.port > 0
    screen.close()
    assert not [thread for thread in threading.enumerate() if thread.name in ("gate", "screen")]


def listening_ports() -> set[int]:
    """TCP ports at which this process listens."""
    own = set()
    for name in os.listdir("/proc/self/fd"):
        with contextlib.suppress(FileNotFoundError):
            own.add(os.readlink(f"/proc/self/fd/{name}"))
    lines = [
        line.split()
        for table in ("tcp", "tcp6")
        for line in Path(f"/proc/self/net/{table}").read_text().splitlines()[1:]
    ]
    return {int(line[1].rsplit(":", 1)[1], 16) for line in lines if line[3] == "0A" and f"socket:[{line[9]}]" in own}


def test_viewer_behind_the_gate_cannot_be_reached_beside_it(data: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = listening_ports()
    with tempfile.TemporaryDirectory() as short:
        monkeypatch.setattr(tempfile, "tempdir", short)
        screen = Screen([Subject("data", data=data)], host="127.0.0.1", port=0, token="secret")
        assert listening_ports() - before == {screen.port}
        (folder,) = Path(short).iterdir()
        assert (folder / "viewer").is_socket()
        assert folder.stat().st_mode & 0o077 == 0, "another user of the machine cannot enter it"
        screen.close()
        assert not folder.exists()


def test_gate_shows_the_viewer_to_who_has_the_token(data: Path) -> None:
    client = pytest.importorskip("websockets.sync.client")
    viser = pytest.importorskip("viser")
    screen = Screen([Subject("data", data=data)], host="127.0.0.1", port=0, token="secret")
    own = f"127.0.0.1:{screen.port}"
    cookie = f"readygo-monitor-{screen.port}=secret"

    def status(**headers: str) -> int:
        connection = http.client.HTTPConnection(own, timeout=60)
        connection.request("GET", "/", headers=headers)
        answer = connection.getresponse()
        body = answer.read()
        connection.close()
        assert (b"<html" in body) == (answer.status == 200)
        return answer.status

    assert (status(), status(Cookie=cookie), status(Cookie=cookie, Origin="http://evil.com")) == (401, 200, 403)

    def first_message(origin: str, **headers: str) -> Any:
        words = f"viser-v{viser.__version__}"
        with client.connect(f"ws://{own}", origin=origin, additional_headers=headers, subprotocols=[words]) as page:
            return page.recv(timeout=60)

    assert first_message(f"http://{own}", Cookie=cookie)
    for origin, headers in (
        ("http://evil.com", {"Cookie": cookie}),
        ("null", {"Cookie": cookie}),
        (f"http://{own}", {}),
    ):
        with pytest.raises(Exception, match=r"HTTP 40[13]"):
            first_message(origin, **headers)
    screen.close()


def test_folder_with_a_long_name_is_refused_in_a_line(
    data: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / ("long" * 30)
    folder.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(folder))
    with pytest.raises(RunError, match="set TMPDIR to a folder with a short name"):
        Screen([Subject("data", data=data)], host="127.0.0.1", port=0)
    assert not list(folder.iterdir())


def test_page_moves_fits_a_telephone_and_survives_the_fleet(
    live: tuple[Screen, Subject, InProcessBus], browser: Any, monkeypatch: pytest.MonkeyPatch
) -> None:
    # However slow the browser is, the episode stays under way.
    monkeypatch.setattr("readygo.apps.monitor.watch.FRESH_S", 1e9)
    screen, subject, run = live
    wrong: list[str] = []
    page = browser.new_page(viewport={"width": 390, "height": 700})
    page.set_default_timeout(120_000)
    page.on("console", lambda said: wrong.append(said.text) if said.type == "error" else None)
    page.on("pageerror", lambda error: wrong.append(str(error)))
    worker = renderer(run, subject.watch)
    tell_status(run, status())
    worker.tell(topics.STATE, states()[0])
    page.goto(f"http://127.0.0.1:{screen.port}/")
    page.get_by_text("flat", exact=True).first.wait_for(state="attached")
    page.get_by_text("of 10 episodes").first.wait_for(state="attached")
    assert page.evaluate("document.documentElement.scrollWidth") <= 390
    wait_for(lambda: screen._pages, 60.0)
    (shown,) = screen._pages.values()
    worker.tell(topics.STATE, states()[0])
    wait_for(lambda: "render0" in shown._cast, 60.0)
    before = np.array(shown._cast["render0"]._nodes["robot"].position)
    worker.tell(topics.STATE, states()[3])
    wait_for(lambda: np.any(shown._cast["render0"]._nodes["robot"].position != before), 60.0)
    worker.bus.close()
    with subject.watch.lock:
        subject.watch.connection = "No fleet is at work."
    page.get_by_text("waiting for the fleet").first.wait_for(state="attached")
    with subject.watch.lock:
        subject.watch.connection = ""
    tell_status(run, status(committed=9))
    page.get_by_text("live", exact=True).first.wait_for(state="attached")
    assert not [text for text in wrong if OF_VISER not in text]
    page.close()
    wait_for(lambda: not screen._pages, 60.0)
