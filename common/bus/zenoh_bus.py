"""The bus over Zenoh: one session per process, queryables for handlers, liveliness tokens for presence.

Multicast and shared memory are off: shared memory corrupts data when a receiver freezes, and a fleet never finds peers
by chance. RELIABLE + BLOCK is no durability, so whatever must arrive is a request with a reply.
"""

import contextlib
import json
import logging
import queue
import socket
import threading
import time
from collections.abc import Callable
from typing import Any, TypeVar

import zenoh

from readygo.common.errors import BusError, ReadygoError
from readygo.common.messages.codec import decode, encode

Request = TypeVar("Request")
Reply = TypeVar("Reply")

log = logging.getLogger(__name__)

_RETRY_S = 0.05
_LEASE_MS = 2000


def _config(mode: str, *, listen: str | None = None, connect: str | None = None) -> zenoh.Config:
    settings = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": _LEASE_MS,
        "queries_default_timeout": 5000,
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
    }
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def free_endpoint() -> str:
    """A loopback endpoint whose port nobody uses right now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _first_words(error: Exception) -> str:
    """What went wrong, without Zenoh's source locations."""
    return str(error).splitlines()[0].split(" at /")[0].strip().rstrip("!.")


class Router:
    """A Zenoh router in this process; close it last."""

    def __init__(self, endpoint: str) -> None:
        """Listen on `endpoint`, such as "tcp/127.0.0.1:7447".

        Raises:
            BusError: If the endpoint cannot be opened, for example because the port is in use.
        """
        self.endpoint = endpoint
        try:
            self._session = zenoh.open(_config("router", listen=endpoint))
        except zenoh.ZError as error:
            reason = "the port is in use" if "in use" in str(error) else _first_words(error)
            raise BusError(f"Cannot listen on {endpoint}: {reason}; choose another --listen endpoint.") from error

    def close(self) -> None:
        """Stop routing."""
        self._session.close()  # type: ignore[no-untyped-call]


class ZenohBus:
    """Serves and asks topics below `readygo/{run}/`; see `readygo.common.bus.Bus`.

    Handlers run on one thread of this bus, in order of arrival, never on Zenoh's own threads: those swallow exceptions
    and stall the link when they are slow.
    """

    def __init__(self, connect: str, run: str) -> None:
        """Open a client session to the router at `connect`.

        Raises:
            BusError: If no router answers there.
        """
        self._prefix = f"readygo/{run}/"
        try:
            self._session = zenoh.open(_config("client", connect=connect))
        except zenoh.ZError as error:
            raise BusError(f"No router answers at {connect}: {_first_words(error)}.") from error
        self._inbox: queue.SimpleQueue[tuple[Any, type, Callable[[Any], Any]] | None] = queue.SimpleQueue()
        self._declared: list[Any] = []
        self._dispatcher = threading.Thread(target=self._dispatch, name="bus", daemon=True)
        self._dispatcher.start()

    def serve(self, topic: str, request_type: type[Request], handler: Callable[[Request], Any]) -> None:
        """Answer requests on `topic` with `handler`."""
        queryable = self._session.declare_queryable(
            self._prefix + topic, lambda query: self._inbox.put((query, request_type, handler)), complete=True
        )
        self._declared.append(queryable)

    def request(self, topic: str, request: Any, reply_type: type[Reply], *, timeout_s: float = 5.0) -> Reply:
        """Ask `topic`; see `Bus.request`. Waits for a server that is still starting, up to the timeout."""
        payload = encode(request)
        deadline_s = time.monotonic() + timeout_s
        while True:
            remaining_s = deadline_s - time.monotonic()
            if remaining_s <= 0:
                raise BusError(f"Nobody answered {self._prefix}{topic} within {timeout_s:g} s.")
            for reply in self._session.get(self._prefix + topic, payload=payload, timeout=max(remaining_s, 0.01)):
                if reply.ok is not None:
                    return decode(reply_type, reply.ok.payload.to_bytes())
                text = reply.err.payload.to_bytes().decode(errors="replace") if reply.err else "no reason given"
                # Zenoh itself answers a query that ran out of time with an error reply.
                if text == "Timeout":
                    raise BusError(f"Nobody answered {self._prefix}{topic} within {timeout_s:g} s.")
                raise BusError(f"{topic}: {text}")
            time.sleep(_RETRY_S)

    def announce(self, role: str, name: str) -> None:
        """Declare that worker `name` of `role` is alive, until the bus is closed or the process dies."""
        self._declared.append(self._session.liveliness().declare_token(f"{self._prefix}alive/{role}/{name}"))

    def watch(self, changed: Callable[[str, str, bool], None]) -> None:
        """Call `changed(role, name, alive)` for every worker that is there, comes or goes."""

        def on_sample(sample: zenoh.Sample) -> None:
            role, name = str(sample.key_expr).rsplit("/", 2)[1:]
            changed(role, name, sample.kind == zenoh.SampleKind.PUT)

        self._declared.append(
            self._session.liveliness().declare_subscriber(f"{self._prefix}alive/*/*", on_sample, history=True)
        )

    def close(self) -> None:
        """Finish the requests that have arrived, then leave the network."""
        for declared in reversed(self._declared):
            declared.undeclare()
        self._inbox.put(None)
        self._dispatcher.join(timeout=5.0)
        self._session.close()  # type: ignore[no-untyped-call]

    def _dispatch(self) -> None:
        while (item := self._inbox.get()) is not None:
            query, request_type, handler = item
            try:
                reply = encode(handler(decode(request_type, query.payload.to_bytes() if query.payload else b"")))
                query.reply(query.key_expr, reply)
            except Exception as error:
                # The asker gets the reason: a handler never swallows.
                text = str(error) if isinstance(error, ReadygoError) else f"{type(error).__name__}: {error}"
                log.warning("%s: %s", query.key_expr, text, exc_info=not isinstance(error, ReadygoError))
                # An asker that is gone must not end the thread that answers all others.
                with contextlib.suppress(zenoh.ZError):
                    query.reply_err(text.encode())
            query.drop()
