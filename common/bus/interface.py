"""The bus as services see it: request and reply by topic, the same over Zenoh and within one process."""

from collections.abc import Callable
from typing import Any, Protocol, TypeVar

Request = TypeVar("Request")
Reply = TypeVar("Reply")


class Bus(Protocol):
    """Serves and asks topics such as "coord/render/claim"; the run's prefix is the bus's own affair."""

    def serve(self, topic: str, request_type: type[Request], handler: Callable[[Request], Any]) -> None:
        """Answer requests on `topic` with `handler`; one request at a time per topic."""
        ...

    def request(self, topic: str, request: Any, reply_type: type[Reply], *, timeout_s: float = 5.0) -> Reply:
        """Ask `topic` and wait for the reply.

        Raises:
            BusError: If nobody answers in time, or the handler failed; the message names the topic and the reason.
        """
        ...
