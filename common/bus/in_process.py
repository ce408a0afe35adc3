"""The bus within one process: handlers are called directly, on the caller's thread."""

from collections.abc import Callable
from typing import Any, TypeVar

from readygo.common.errors import BusError

Request = TypeVar("Request")
Reply = TypeVar("Reply")


class InProcessBus:
    """Calls the handler of a topic directly with the request object."""

    def __init__(self) -> None:
        self._handlers: dict[str, Callable[[Any], Any]] = {}

    def serve(self, topic: str, request_type: type[Request], handler: Callable[[Request], Any]) -> None:
        """Answer requests on `topic` with `handler`."""
        self._handlers[topic] = handler

    def request(self, topic: str, request: Any, reply_type: type[Reply], *, timeout_s: float = 5.0) -> Reply:
        """Ask `topic`; see `Bus.request`."""
        if topic not in self._handlers:
            raise BusError(f"Nobody serves {topic!r}; served: {', '.join(sorted(self._handlers)) or 'nothing'}.")
        reply = self._handlers[topic](request)
        if not isinstance(reply, reply_type):
            raise BusError(f"{topic!r} answered {type(reply).__name__}, not {reply_type.__name__}.")
        return reply
