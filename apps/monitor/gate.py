"""The authenticating proxy in front of the page: checks each request, and passes it to the viewer.

The viewer has no authentication, so it listens at a Unix socket that only this user can reach. A page on the loopback
address is for this machine: pages of other sites that a browser has open must not read it (a foreign Origin), nor by a
name of theirs that points here (a foreign Host). On any other address the proxy requires a token, once in the link and
then in a cookie.
"""

import asyncio
import hmac
import logging
import threading
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import NamedTuple
from urllib.parse import parse_qsl, urlencode, urlsplit

from readygo.common.errors import RunError

HEAD_MAX = 32_768
"""Largest size of a request's head [bytes]."""
HEAD_TIMEOUT_S = 10.0
PIECE = 65_536
_log = logging.getLogger(__name__)
LOOPBACK = ("127.0.0.1", "localhost", "::1")


class Request(NamedTuple):
    """The head of a request."""

    target: str
    """Path and query of the URL."""
    headers: Mapping[str, str]
    """Headers by name in lower case."""


@dataclass(frozen=True)
class Answer:
    """A response of the proxy itself."""

    status: str
    text: str = ""
    location: str = ""
    cookie: str = ""

    def to_bytes(self) -> bytes:
        """The HTTP response as bytes."""
        body = self.text.encode()
        lines = [f"HTTP/1.1 {self.status}", "Content-Type: text/plain; charset=utf-8", f"Content-Length: {len(body)}"]
        lines += [f"Location: {self.location}"] if self.location else []
        lines += [f"Set-Cookie: {self.cookie}"] if self.cookie else []
        return "\r\n".join([*lines, "Connection: close", "", ""]).encode() + body


def parse_head(head: bytes) -> Request | None:
    """Parse the head of an HTTP request; None if it is malformed."""
    first, *lines = head.decode("latin-1").split("\r\n")
    parts = first.split(" ")
    if len(parts) != 3 or not parts[2].startswith("HTTP/1."):
        return None
    pairs = (line.partition(":") for line in lines if line)
    headers = {name.strip().lower(): value.strip() for name, _, value in pairs}
    try:
        # Python's URL parser raises ValueError for some malformed addresses, such as "[::1".
        for url in (parts[1], f"//{headers.get('host', '')}", headers.get("origin", "")):
            _ = urlsplit(url).hostname
    except ValueError:
        return None
    return Request(parts[1], headers)


def judge(request: Request, token: str, cookie_name: str) -> Answer | None:
    """The proxy's response to a request; None passes the request to the viewer.

    Args:
        request: Head of the request.
        token: Required token; empty allows every request that names this machine as its host.
        cookie_name: Name of the cookie with the token.
    """
    host, origin = request.headers.get("host", ""), request.headers.get("origin")
    if origin is not None and (not host or origin not in (f"http://{host}", f"https://{host}")):
        return Answer("403 Forbidden", "This page is not for other sites.\n")
    if not token:
        return None if _hostname(host) in LOOPBACK else Answer("403 Forbidden", "Ask for this page as localhost.\n")
    cookies = dict(part.strip().partition("=")[::2] for part in request.headers.get("cookie", "").split(";"))
    if hmac.compare_digest(cookies.get(cookie_name, "").encode(), token.encode()):
        return None
    url = urlsplit(request.target)
    query = parse_qsl(url.query)
    if any(name == "token" and hmac.compare_digest(value.encode(), token.encode()) for name, value in query):
        rest = urlencode([(name, value) for name, value in query if name != "token"])
        path = "/" + url.path.lstrip("/")
        cookie = f"{cookie_name}={token}; HttpOnly; SameSite=Strict; Path=/"
        return Answer("303 See Other", location=path + (f"?{rest}" if rest else ""), cookie=cookie)
    return Answer("401 Unauthorized", "Open the link with its token that `readygo monitor` printed.\n")


def _hostname(host: str) -> str | None:
    """The host name in a Host header; None if there is none."""
    try:
        return urlsplit(f"//{host}").hostname
    except ValueError:
        return None


class Gate:
    """Server of the page's address, on a separate thread."""

    def __init__(self, host: str, port: int, *, behind: Path, token: str = "") -> None:
        """Start the server.

        Args:
            host: Address of this machine.
            port: Port; 0 takes a free one.
            behind: Unix socket of the viewer.
            token: Required token; empty for the loopback address.

        Raises:
            RunError: If the address cannot be opened.
        """
        self._behind, self._token = behind, token
        self._loop = asyncio.new_event_loop()
        self._tasks: set[asyncio.Task[None]] = set()
        try:
            self._server = self._loop.run_until_complete(
                asyncio.start_server(self._welcome, host, port, limit=HEAD_MAX)
            )
        except (OSError, OverflowError) as error:
            self._loop.close()
            what = getattr(error, "strerror", None) or error
            raise RunError(
                f"Cannot show the page at {host}:{port}: {what}; choose another --host or --port."
            ) from error
        self.port: int = self._server.sockets[0].getsockname()[1]
        """Port of the server."""
        self._cookie_name = f"readygo-monitor-{self.port}"
        self._thread = threading.Thread(target=self._loop.run_forever, name="gate", daemon=True)
        self._thread.start()

    def close(self) -> None:
        """Stop the server, and close all connections."""
        asyncio.run_coroutine_threadsafe(self._end(), self._loop).result()
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join()
        self._loop.close()

    async def _end(self) -> None:
        self._server.close()
        for task in tuple(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)

    async def _welcome(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        task = asyncio.current_task()
        assert task is not None
        self._tasks.add(task)
        try:
            await self._serve(reader, writer)
        except (OSError, asyncio.IncompleteReadError, asyncio.LimitOverrunError):
            # A browser may disconnect at any time.
            pass
        finally:
            self._tasks.discard(task)
            writer.close()

    async def _serve(self, reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
        head = await asyncio.wait_for(reader.readuntil(b"\r\n\r\n"), HEAD_TIMEOUT_S)
        request = parse_head(head)
        answer = judge(request, self._token, self._cookie_name) if request else Answer("400 Bad Request")
        if answer is not None:
            writer.write(answer.to_bytes())
            await writer.drain()
            return
        try:
            inner_reader, inner_writer = await asyncio.open_unix_connection(self._behind)
        except OSError as error:
            _log.warning("The page's server does not answer: %s", error)
            writer.write(Answer("502 Bad Gateway", "The page's server does not answer; see the log.\n").to_bytes())
            await writer.drain()
            return
        inner_writer.write(head)
        ways = [asyncio.ensure_future(_pass_on(*way)) for way in ((reader, inner_writer), (inner_reader, writer))]
        try:
            # When one side has closed, the other one has no receiver.
            await asyncio.wait(ways, return_when=asyncio.FIRST_COMPLETED)
        finally:
            for way in ways:
                way.cancel()
            await asyncio.gather(*ways, return_exceptions=True)
            inner_writer.close()


async def _pass_on(reader: asyncio.StreamReader, writer: asyncio.StreamWriter) -> None:
    while data := await reader.read(PIECE):
        writer.write(data)
        await writer.drain()
