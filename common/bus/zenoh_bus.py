"""The bus over Zenoh: one session per process, queryables for handlers, liveliness tokens for presence.

Multicast and shared memory are off: shared memory corrupts data when a receiver freezes, and a fleet never finds peers
by chance. RELIABLE + BLOCK is no durability, so every message that must arrive is a request with a reply; published
messages are dropped when the link is full. Zenoh's own threads only put what arrives into the inbox: they swallow
exceptions, and stall the link when they are slow.
"""

import contextlib
import json
import logging
import random
import socket
import tempfile
import time
import uuid
from collections.abc import Callable, Collection, Mapping
from functools import partial
from typing import Any, TypeVar

import zenoh

from readygo.common.bus.endpoint import check_endpoint
from readygo.common.bus.identity import ANONYMOUS, Identity, Member
from readygo.common.bus.inbox import Inbox, Mailbox
from readygo.common.bus.rights import refusal
from readygo.common.bus.teller import Teller
from readygo.common.errors import BusError, CertificateError, MessageError, PeerError, ReadygoError, first_line, reason
from readygo.common.left_open import note_open
from readygo.common.messages.checks import NAME_MAX
from readygo.common.messages.codec import MESSAGE_BYTES_MAX, decode, encode
from readygo.common.messages.topics import Live, Stream, Topic, presence

Request = TypeVar("Request")
Reply = TypeVar("Reply")
Message = TypeVar("Message")

log = logging.getLogger(__name__)

_RETRY_S = 0.05
_ASTRAY = "astray"
"""Answer to a request for another topic: while links break under load and come back, Zenoh has handed requests to a
server of another key. Each carries its topic's name therefore, and is sent again."""
_LEASE_MS = 2000
_GONE_S = 2 * _LEASE_MS / 1000
"""After so long the token of a process whose host is gone is gone as well [s]."""


_NOT_IN_NAMES = "/*$?#"
"""They divide Zenoh's keys, or stand for parts of them."""
_USER = "run"
_LOGGED = "zenoh_link_tls=warn"
"""What Zenoh says on standard output of a router: whose certificates were refused, and why."""


def _config(
    mode: str, token: str, identity: Identity | None = None, *, listen: str | None = None, connect: str | None = None
) -> zenoh.Config:
    settings: dict[str, Any] = {
        "mode": mode,
        "scouting/multicast/enabled": False,
        "transport/shared_memory/enabled": False,
        "transport/link/tx/lease": _LEASE_MS,
        # How long a router waits for a full way before it drops a message of a slow subscriber, for each 64 kB of it
        # [us]; by default 1 ms. Without any wait a message of more than one such part never arrives.
        "transport/link/tx/queue/congestion_control/drop/wait_before_drop": 100,
        "transport/link/tx/queue/size/data_low": 16,
        "transport/link/rx/max_message_size": MESSAGE_BYTES_MAX,
        "queries_default_timeout": 5000,
        "listen/endpoints": [listen] if listen else [],
        "connect/endpoints": [connect] if connect else [],
    }
    if token:
        settings |= {"transport/auth/usrpwd/user": _USER, "transport/auth/usrpwd/password": token}
    if identity:
        settings |= _tls_settings(identity)
    config = zenoh.Config()
    for key, value in settings.items():
        config.insert_json5(key, json.dumps(value))
    return config


def _tls_settings(identity: Identity) -> dict[str, Any]:
    """Both sides show a certificate of the fleet's authority; a link ends when one of the two expires."""
    certificate, key = str(identity.certificate), str(identity.key)
    settings = {
        "root_ca_certificate": str(identity.authority),
        "enable_mtls": True,
        "close_link_on_expiration": True,
        "listen_certificate": certificate,
        "listen_private_key": key,
        "connect_certificate": certificate,
        "connect_private_key": key,
    }
    return {f"transport/link/tls/{name}": value for name, value in settings.items()}


def free_endpoint() -> str:
    """A loopback endpoint whose port no process uses right now."""
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        return f"tcp/127.0.0.1:{probe.getsockname()[1]}"


def _first_words(error: Exception) -> str:
    """What went wrong, without Zenoh's source locations."""
    return first_line(error).split(" at /")[0].strip().rstrip("!.")


class Router:
    """A Zenoh router in this process; close it last."""

    def __init__(
        self,
        endpoint: str,
        token: str = "",
        identity: Identity | None = None,
        access: Mapping[str, Any] | None = None,
    ) -> None:
        """Listen on `endpoint`, such as "tcp/127.0.0.1:7447".

        Args:
            endpoint: Where to listen.
            token: What all who connect must know, letters and digits; empty lets everybody in.
            identity: The certificate that is shown to those who connect by TLS; they must show one as well.
            access: Who may do what then, see `access_control`.

        Raises:
            ConfigError: If the endpoint is none.
            BusError: If it cannot be opened, for example because the port is in use.
        """
        check_endpoint(endpoint)
        self.endpoint = endpoint
        if identity:
            zenoh.init_log_from_env_or(_LOGGED)
        try:
            config = _config("router", token, identity, listen=endpoint)
            if access:
                config.insert_json5("access_control", json.dumps(access))
            # The router reads the file when it opens; no other user may read it.
            with tempfile.NamedTemporaryFile("w", suffix=".txt") as users:
                if token:
                    users.write(f"{_USER}:{token}\n")
                    users.flush()
                    config.insert_json5("transport/auth/usrpwd/dictionary_file", json.dumps(users.name))
                self._session = zenoh.open(config)
        except zenoh.ZError as error:
            reason = "the port is in use" if "in use" in str(error) else _first_words(error)
            raise BusError(f"Cannot listen on {endpoint}: {reason}; choose another --listen endpoint.") from error

    def close(self) -> None:
        """Stop routing."""
        self._session.close()  # type: ignore[no-untyped-call]


class ZenohBus:
    """One Zenoh session below `readygo/{run}/`; see `readygo.common.bus.Bus`."""

    def __init__(self, connect: str, run: str, token: str = "", identity: Identity | None = None) -> None:
        """Open a client session to the router at `connect`.

        Args:
            connect: Where the router listens.
            run: Name of the run.
            token: What the router wants to hear of those who connect.
            identity: The certificate that is shown to a router that is reached by TLS.

        Raises:
            ConfigError: If `connect` is no endpoint.
            BusError: If no router answers there, or it wants another token or certificate.
        """
        check_endpoint(connect)
        self._prefix = f"readygo/{run}/"
        self._certified = identity is not None
        self._asker = identity.name if identity else ANONYMOUS
        try:
            self._session = zenoh.open(_config("client", token, identity, connect=connect))
        except zenoh.ZError as error:
            hint = "" if token else ", or it wants the run's token"
            if identity:
                hint = f", or it refuses the certificate {identity.certificate} or shows one for another host"
            raise BusError(f"No router answers at {connect}{hint}: {_first_words(error)}.") from error
        self._inbox = Inbox()
        self._declared: list[Any] = []
        self._publishers: dict[str, zenoh.Publisher] = {}
        self._not_understood: set[str] = set()
        self._teller = Teller(self)
        note_open(self)

    def serve(
        self, topic: Topic[Request, Reply], handler: Callable[[Request], Reply], *, by: Collection[str] = ()
    ) -> None:
        """Answer requests on `topic` with `handler`; see `Bus.serve`."""

        def handle_allowed(asker: str, request: Request) -> Reply:
            if self._certified and (why := refusal(asker, by, request)):
                raise CertificateError(f"refused: {why}.")
            return handler(request)

        def on_query(query: zenoh.Query) -> None:
            self._inbox.put(lambda: _answer(query, topic, handle_allowed))

        key = f"{self._prefix}by/*/{topic.name}"
        self._declared.append(self._session.declare_queryable(key, on_query, complete=True))

    def request(self, topic: Topic[Request, Reply], request: Request, *, timeout_s: float = 5.0) -> Reply:
        """Ask `topic`; see `Bus.request`. Waits for a server that is still starting, up to the timeout."""
        key, payload = f"{self._prefix}by/{self._asker}/{topic.name}", encode(request)
        deadline_s, meant = time.monotonic() + timeout_s, topic.name.encode()
        while (remaining_s := deadline_s - time.monotonic()) > 0:
            waiting_s = max(remaining_s, 0.01)
            for reply in self._session.get(key, payload=payload, attachment=meant, timeout=waiting_s):
                if reply.ok is not None:
                    return _decode_reply(topic, reply.ok.payload.to_bytes())
                text = reply.err.payload.to_bytes().decode(errors="replace") if reply.err else "no reason given"
                # Zenoh itself answers a query that ran out of time with an error reply.
                if text not in ("Timeout", _ASTRAY):
                    raise PeerError(f"{topic.name}: {text}")
            time.sleep(_RETRY_S)
        raise BusError(f"No participant answered {key} within {timeout_s:g} s.")

    def publish(self, stream: Stream[Message], message: Message) -> None:
        """Give `message` to those who hear `stream`; see `Bus.publish`. Without any it is not even encoded."""
        if self.heard(stream):
            self._publisher(stream).put(encode(message))

    def heard(self, stream: Stream[Message]) -> bool:
        """True if a subscriber listens to `stream`."""
        return bool(self._publisher(stream).matching_status.matching)  # type: ignore[attr-defined]

    def tell(self, live: Live[Message], make: Callable[[], Message]) -> None:
        """Show what is under way; see `Bus.tell`."""
        self._teller.tell(live, make)

    def _publisher(self, stream: Stream[Message]) -> zenoh.Publisher:
        publisher = self._publishers.get(stream.name)
        if publisher is None:
            publisher = self._publishers[stream.name] = self._session.declare_publisher(
                self._prefix + stream.name,
                congestion_control=zenoh.CongestionControl.DROP,
                priority=zenoh.Priority.DATA_LOW,
            )
            self._declared.append(publisher)
        return publisher

    def subscribe(self, stream: Stream[Message], handler: Callable[[Message], None]) -> None:
        """Hear `stream`; see `Bus.subscribe`."""
        mailbox: Mailbox[bytes] = Mailbox(self._inbox, partial(self._hear, stream, handler))
        self._declared.append(
            self._session.declare_subscriber(
                self._prefix + stream.name, lambda sample: mailbox.put(sample.payload.to_bytes())
            )
        )

    def _hear(self, stream: Stream[Message], handler: Callable[[Message], None], payload: bytes) -> None:
        try:
            message = decode(stream.message_type, payload)
        except MessageError as error:
            if stream.name not in self._not_understood:
                self._not_understood.add(stream.name)
                log.warning("%s: what does not fit is left out; another version of readygo? %s", stream.name, error)
            return
        handler(message)

    def announce(self, role: str, name: str, *, turn: int = 0, replaced: Callable[[], object] | None = None) -> str:
        """Say that a worker is alive; see `Bus.announce`. One that has just died may still seem to be there."""
        if not _is_name(role) or not _is_name(name):
            raise BusError(
                f"A {role!a} cannot be called {name!a}: a name has 1..{NAME_MAX} printable characters, none of "
                f"{' '.join(_NOT_IN_NAMES)}; choose another --name."
            )
        session = uuid.uuid4().hex
        key = self._prefix + presence(role, name)
        self._claim(key, session, f"Another {role} of the run is called {name!r}: choose another --name.")
        if replaced is not None:
            self._watch_for_successors(key, turn, replaced)
        self._teller.me = role, name
        self._declared.append(self._session.liveliness().declare_token(f"{key}/{session}"))
        # Once this question is answered, the router knows the token: every participant that asks from now on sees it.
        self._tokens(f"{key}/{session}")
        return session

    def _claim(self, key: str, session: str, taken: str) -> None:
        """Be the only one below `key`: who sees another one's token beside its own takes it back, and tries again."""
        own, deadline_s = f"{key}/claim/{session}", time.monotonic() + _GONE_S
        while True:
            if not self._tokens(f"{key}/**"):
                token = self._session.liveliness().declare_token(own)
                if self._tokens(f"{key}/**") <= {own}:
                    self._declared.append(token)
                    return
                token.undeclare()  # type: ignore[no-untyped-call]
            if time.monotonic() > deadline_s:
                raise BusError(taken)
            time.sleep(random.uniform(1.0, 3.0) * _RETRY_S)

    def _watch_for_successors(self, key: str, turn: int, replaced: Callable[[], object]) -> None:
        """Show the turn of the one who has won `key`, and hear of those who have won it later."""
        own = f"{key}/turn/{turn:020d}"
        self._declared.append(self._session.liveliness().declare_token(own))

        def on_sample(sample: zenoh.Sample) -> None:
            if sample.kind == zenoh.SampleKind.PUT and str(sample.key_expr) > own:
                replaced()

        self._declared.append(self._session.liveliness().declare_subscriber(f"{key}/turn/*", on_sample, history=True))

    def _tokens(self, keys: str) -> set[str]:
        """Keys of the liveliness tokens that the router knows."""
        replies = self._session.liveliness().get(keys, timeout=_GONE_S)
        return {str(reply.ok.key_expr) for reply in replies if reply.ok}

    def watch(self, changed: Callable[[Member, bool], None]) -> None:
        """Hear of workers; see `Bus.watch`."""

        def on_sample(sample: zenoh.Sample) -> None:
            member = Member(*str(sample.key_expr).rsplit("/", 3)[1:])
            if not (_is_name(member.role) and _is_name(member.name)):
                # `announce` lets no process be called so.
                return
            alive = sample.kind == zenoh.SampleKind.PUT
            self._inbox.put(lambda: changed(member, alive))

        keys = f"{self._prefix}{presence('*', '*')}/*"
        self._declared.append(self._session.liveliness().declare_subscriber(keys, on_sample, history=True))

    def close(self) -> None:
        """Finish what has arrived, then leave the network."""
        while self._declared:
            self._declared.pop().undeclare()
        self._inbox.close()
        self._session.close()  # type: ignore[no-untyped-call]


def _is_name(name: str) -> bool:
    """True for what a role or a process may be called: it is part of a key, and it is shown."""
    return 0 < len(name) <= NAME_MAX and name.isprintable() and not set(name) & set(_NOT_IN_NAMES)


def _decode_reply(topic: Topic[Request, Reply], payload: bytes) -> Reply:
    try:
        return decode(topic.reply_type, payload)
    except MessageError as error:
        raise PeerError(f"{topic.name}: {error}") from error


def _answer(query: zenoh.Query, topic: Topic[Request, Reply], handler: Callable[[str, Request], Reply]) -> None:
    try:
        if not query.attachment or query.attachment.to_bytes() != topic.name.encode():
            raise BusError(_ASTRAY)
        asker = str(query.key_expr).split("/")[3]
        request = decode(topic.request_type, query.payload.to_bytes() if query.payload else b"")
        reply = encode(handler(asker, request))
        query.reply(query.key_expr, reply)
    except Exception as error:
        # The asker gets the reason: a handler never swallows.
        log.warning("%s: %s", query.key_expr, error, exc_info=not isinstance(error, ReadygoError))
        # An asker that is gone must not end the thread that answers all others.
        with contextlib.suppress(zenoh.ZError):
            query.reply_err(reason(error).encode())
    query.drop()  # type: ignore[no-untyped-call]
