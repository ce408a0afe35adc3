"""Zenoh among programs that are not readygo's: keys, payloads and attachments as those have them."""

import contextlib
import time
from collections.abc import Callable
from typing import Any

import zenoh

from readygo.common.bus.endpoint import check_endpoint
from readygo.common.bus.zenoh_bus import _config, _first_words
from readygo.common.errors import BusError
from readygo.common.left_open import note_open

Hear = Callable[[str, bytes, bytes], None]
"""Gets key, payload and attachment, on a thread of Zenoh's: it leaves them somewhere and returns."""


class ForeignSession:
    """One Zenoh client; close it when done."""

    def __init__(self, connect: str) -> None:
        """Connect.

        Args:
            connect: Where a Zenoh router listens, such as "tcp/127.0.0.1:7447".

        Raises:
            ConfigError: If `connect` is no endpoint.
            BusError: If no router answers there.
        """
        check_endpoint(connect)
        try:
            self._session = zenoh.open(_config("client", "", None, connect=connect))
        except zenoh.ZError as error:
            raise BusError(f"No Zenoh router answers at {connect}: {_first_words(error)}.") from error
        self._declared: list[Any] = []
        note_open(self)

    @property
    def name(self) -> str:
        """The session's id, as Zenoh writes it."""
        return str(self._session.zid())

    def hear(self, key: str, hear: Hear) -> None:
        """Hear what is published on the keys that an expression stands for."""

        def on_sample(sample: zenoh.Sample) -> None:
            attachment = sample.attachment.to_bytes() if sample.attachment else b""
            hear(str(sample.key_expr), sample.payload.to_bytes(), attachment)

        self._declared.append(self._session.declare_subscriber(key, on_sample))

    def publisher(self, key: str, *, block: bool = False) -> "ForeignPublisher":
        """Publish on a key, at once and before anything else that is under way.

        Args:
            key: Where.
            block: True waits where the way is full, False drops the message.
        """
        publisher = self._session.declare_publisher(
            key,
            congestion_control=zenoh.CongestionControl.BLOCK if block else zenoh.CongestionControl.DROP,
            priority=zenoh.Priority.INTERACTIVE_HIGH,
            express=True,
        )
        self._declared.append(publisher)
        return ForeignPublisher(publisher)

    def announce(self, key: str) -> None:
        """Show a liveliness token until the session ends."""
        self._declared.append(self._session.liveliness().declare_token(key))

    def present(self, key: str, timeout_s: float = 1.0) -> list[str]:
        """The liveliness tokens that are there."""
        replies = self._session.liveliness().get(key, timeout=timeout_s)
        return sorted(str(reply.ok.key_expr) for reply in replies if reply.ok is not None)

    def close(self) -> None:
        """Leave the network."""
        with contextlib.suppress(zenoh.ZError):
            while self._declared:
                self._declared.pop().undeclare()
        self._session.close()  # type: ignore[no-untyped-call]


class ForeignPublisher:
    """Publishes on one key."""

    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher

    def put(self, payload: bytes, attachment: bytes = b"") -> None:
        """Publish a payload."""
        self._publisher.put(payload, attachment=attachment or None)

    def heard(self, timeout_s: float = 0.0) -> bool:
        """True if a subscriber listens, or one comes within `timeout_s`."""
        until_s = time.monotonic() + timeout_s
        while not self._publisher.matching_status.matching:
            if time.monotonic() >= until_s:
                return False
            time.sleep(0.02)
        return True
