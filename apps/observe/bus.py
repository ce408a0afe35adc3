"""A bus that is watched: what goes through it is measured and traced."""

from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from typing import Any, Protocol, TypeVar

from readygo.common.bus import Bus, Member
from readygo.common.messages.topics import Live, Stream, Topic

Request = TypeVar("Request")
Reply = TypeVar("Reply")
Message = TypeVar("Message")


class Watcher(Protocol):
    """Who watches."""

    def requesting(self, topic: str) -> AbstractContextManager[None]:
        """Holds while this process waits for the answer to a request."""
        ...

    def handling(self, topic: str) -> AbstractContextManager[None]:
        """Holds while this process answers one."""
        ...


class WatchedBus:
    """See `readygo.common.bus.Bus`; lossy streams are not watched."""

    def __init__(
        self, bus: Bus, watchers: tuple[Watcher, ...], answered: Callable[[str, Any, Any], None] | None = None
    ) -> None:
        """Take part in a run through another bus.

        Args:
            bus: The bus itself.
            watchers: Who watches, the outermost first.
            answered: Hears topic, request and reply of every request that this process has answered.
        """
        self._bus, self._watchers, self._answered = bus, watchers, answered

    def serve(self, topic: Topic[Request, Reply], handler: Callable[[Request], Reply], **rights: Any) -> None:
        """See `Bus.serve`."""

        def handle(request: Request) -> Reply:
            with ExitStack() as watched:
                for watcher in self._watchers:
                    watched.enter_context(watcher.handling(topic.name))
                reply = handler(request)
            if self._answered:
                self._answered(topic.name, request, reply)
            return reply

        self._bus.serve(topic, handle, **rights)

    def request(self, topic: Topic[Request, Reply], request: Request, *, timeout_s: float = 5.0) -> Reply:
        """See `Bus.request`."""
        with ExitStack() as watched:
            for watcher in self._watchers:
                watched.enter_context(watcher.requesting(topic.name))
            return self._bus.request(topic, request, timeout_s=timeout_s)

    def publish(self, stream: Stream[Message], message: Message) -> None:
        """See `Bus.publish`."""
        self._bus.publish(stream, message)

    def tell(self, live: Live[Message], make: Callable[[], Message]) -> None:
        """See `Bus.tell`."""
        self._bus.tell(live, make)

    def subscribe(self, stream: Stream[Message], handler: Callable[[Message], None]) -> None:
        """See `Bus.subscribe`."""
        self._bus.subscribe(stream, handler)

    def announce(self, role: str, name: str, *, turn: int = 0, replaced: Callable[[], object] | None = None) -> str:
        """See `Bus.announce`."""
        return self._bus.announce(role, name, turn=turn, replaced=replaced)

    def watch(self, changed: Callable[[Member, bool], None]) -> None:
        """See `Bus.watch`."""
        self._bus.watch(changed)

    def close(self) -> None:
        """See `Bus.close`."""
        self._bus.close()
