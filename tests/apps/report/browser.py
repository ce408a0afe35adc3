"""Headless Chromium for tests of pages, spoken to through the pipe of its debugging protocol."""

import base64
import fcntl
import itertools
import json
import os
import shutil
import subprocess
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

CHROMIUM = shutil.which("chromium") or shutil.which("chromium-browser") or shutil.which("google-chrome")
NO_CHROMIUM = "no Chromium is installed"
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--hide-scrollbars",
    "--no-first-run",
    "--disable-extensions",
    "--disable-background-networking",
    "--autoplay-policy=no-user-gesture-required",
)


class Browser:
    """One page of a browser that runs."""

    def __init__(self, commands: int, answers: int) -> None:
        """Attach to a page.

        Args:
            commands: File to write the protocol's messages to.
            answers: File to read them from.
        """
        self._commands, self._answers = commands, answers
        self._numbers, self._rest, self._session = itertools.count(1), b"", ""
        self.complaints: list[str] = []
        """Errors and warnings on the console, exceptions of scripts and failed requests, in order."""
        target = self._ask("Target.createTarget", url="about:blank")["targetId"]
        self._session = self._ask("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._ask(f"{domain}.enable")

    def open(self, page: Path, width_px: int, *, height_px: int = 800) -> None:
        """Load a file in a window of a width, and wait for it."""
        size = {"width": width_px, "height": height_px, "deviceScaleFactor": 1, "mobile": False}
        self._ask("Emulation.setDeviceMetricsOverride", **size)
        self.complaints.clear()
        self._ask("Page.navigate", url=page.resolve().as_uri())
        self.run("new Promise(done => document.readyState == 'complete' ? done() : addEventListener('load', done))")

    def run(self, script: str) -> Any:
        """The value of an expression in the page; promises are waited for."""
        reply = self._ask("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        if "exceptionDetails" in reply:
            raise AssertionError(f"{script}: {reply['exceptionDetails']}")
        return reply["result"].get("value")

    def screenshot(self, path: Path) -> None:
        """Write the whole page as PNG."""
        reply = self._ask("Page.captureScreenshot", format="png", captureBeyondViewport=True)
        path.write_bytes(base64.b64decode(reply["data"]))

    def _ask(self, method: str, **parameters: Any) -> dict[str, Any]:
        number = next(self._numbers)
        message = {"id": number, "method": method, "params": parameters}
        if self._session:
            message["sessionId"] = self._session
        os.write(self._commands, json.dumps(message).encode() + b"\0")
        while (reply := self._next()).get("id") != number:
            self._note(reply)
        assert "error" not in reply, reply
        result: dict[str, Any] = reply["result"]
        return result

    def _next(self) -> dict[str, Any]:
        while b"\0" not in self._rest:
            read = os.read(self._answers, 1 << 20)
            assert read, "the browser ended"
            self._rest += read
        text, self._rest = self._rest.split(b"\0", 1)
        message: dict[str, Any] = json.loads(text)
        return message

    def _note(self, event: dict[str, Any]) -> None:
        method, what = event.get("method"), event.get("params", {})
        if method == "Runtime.exceptionThrown" or (
            method == "Runtime.consoleAPICalled" and what["type"] in ("error", "warning", "assert")
        ):
            self.complaints.append(json.dumps(what)[:400])
        elif method == "Log.entryAdded" and what["entry"]["level"] in ("error", "warning"):
            self.complaints.append(what["entry"]["text"])
        elif method == "Network.loadingFailed":
            self.complaints.append(what["errorText"])


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """A browser with a profile of its own, which ends with the block."""
    assert CHROMIUM is not None, NO_CHROMIUM
    theirs_in, commands = os.pipe()
    answers, theirs_out = os.pipe()
    # Chromium reads its commands from file 3 and answers on file 4; the shell's own numbers must be out of their way.
    passed = [fcntl.fcntl(file, fcntl.F_DUPFD, 10) for file in (theirs_in, theirs_out)]
    line = f'exec "$0" "$@" 3<&{passed[0]} 4>&{passed[1]}'
    flags = [*_FLAGS, f"--user-data-dir={profile}", "--remote-debugging-pipe"]
    process = subprocess.Popen(
        ["bash", "-c", line, CHROMIUM, *flags],
        pass_fds=passed,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
    )
    for file in (theirs_in, theirs_out, *passed):
        os.close(file)
    try:
        yield Browser(commands, answers)
    finally:
        process.terminate()
        process.wait(timeout=60)
        os.close(commands)
        os.close(answers)


def assert_readable(page: Browser, width_px: int) -> None:
    """Assert that nothing is cut or has to be scrolled to the side, and that text is at least 10 px high."""
    assert page.run("document.documentElement.scrollWidth") == width_px
    for script in (_OUTSIDE, _SMALL_TEXTS):
        wrong = page.run(script)
        assert wrong == [], wrong


def assert_films_play(page: Browser) -> None:
    """Assert that there are films, and that each of them has pictures and goes on."""
    films = page.run(_PLAYED)
    assert films
    for width_px, seconds in films:
        assert width_px > 0
        assert seconds > 0.0


# Elements with something to be scrolled to inside, or that reach beyond the window, and text beyond its chart.
_OUTSIDE = """[...document.querySelectorAll('main *')].filter(element => {
  const box = element.getBoundingClientRect(), chart = element.closest('svg')?.getBoundingClientRect()
  const left = chart?.left ?? 0, right = chart?.right ?? innerWidth
  const scrolls = element.scrollWidth > element.clientWidth + 1 && getComputedStyle(element).display != 'inline'
  return box.width && (box.left < left - 1 || box.right > right + 1 || (scrolls && !chart && element.clientWidth))
}).map(element => element.outerHTML.slice(0, 120))"""

_SMALL_TEXTS = """[...document.querySelectorAll('main *')].filter(element => {
  const own = [...element.childNodes].some(node => node.nodeType == Node.TEXT_NODE && node.data.trim())
  const scale = element.ownerSVGElement?.getScreenCTM().a ?? 1
  return own && element.localName != 'title' && parseFloat(getComputedStyle(element).fontSize) * scale < 10
}).map(element => element.outerHTML.slice(0, 120))"""

_PLAYED = """Promise.all([...document.querySelectorAll('video')].map(async film => {
  film.loop = true
  await film.play()
  const begin = performance.now()
  while (film.currentTime == 0 && performance.now() - begin < 10000) await new Promise(requestAnimationFrame)
  return [film.videoWidth, film.currentTime]
}))"""
