"""A bus whose requests are measured."""

from collections.abc import Callable
from typing import Any, TypeVar

from readygo.apps.observe.metrics import Metrics
from readygo.common.bus import Bus, Member
from readygo.common.messages.topics import Live, Stream, Topic

Request = TypeVar("Request")
Reply = TypeVar("Reply")
Message = TypeVar("Message")


class WatchedBus:
    """A `readygo.common.bus.Bus` whose requests are measured; lossy streams are not."""

    def __init__(self, bus: Bus, metrics: Metrics, answered: Callable[[Any, Any], None]) -> None:
        """Take part in a run through another bus.

        Args:
            bus: The bus itself.
            metrics: Gets the durations of the requests.
            answered: Called with every request that this process has handled, and its reply.
        """
        self._bus, self._metrics, self._answered = bus, metrics, answered

    def serve(self, topic: Topic[Request, Reply], handler: Callable[[Request], Reply], **rights: Any) -> None:
        """Serve a topic with a measured handler; arguments as in `Bus.serve`."""

        def handle(request: Request) -> Reply:
            with self._metrics.handling(topic.name):
                reply = handler(request)
            self._answered(request, reply)
            return reply

        self._bus.serve(topic, handle, **rights)

    def request(self, topic: Topic[Request, Reply], request: Request, *, timeout_s: float = 5.0) -> Reply:
        """Send a request and wait for its reply, measured."""
        with self._metrics.requesting(topic.name):
            return self._bus.request(topic, request, timeout_s=timeout_s)

    def publish(self, stream: Stream[Message], message: Message) -> None:
        """Publish a message on a stream."""
        self._bus.publish(stream, message)

    def tell(self, live: Live[Message], make: Callable[[], Message]) -> None:
        """Publish live data, which is made only if there is a subscriber."""
        self._bus.tell(live, make)

    def subscribe(self, stream: Stream[Message], handler: Callable[[Message], None]) -> None:
        """Subscribe to a stream."""
        self._bus.subscribe(stream, handler)

    def announce(self, role: str, name: str, *, turn: int = 0, replaced: Callable[[], object] | None = None) -> str:
        """Announce this process; arguments as in `Bus.announce`."""
        return self._bus.announce(role, name, turn=turn, replaced=replaced)

    def watch(self, changed: Callable[[Member, bool], None]) -> None:
        """Call `changed` when a process joins or leaves."""
        self._bus.watch(changed)

    def close(self) -> None:
        """Leave the run."""
        self._bus.close()
