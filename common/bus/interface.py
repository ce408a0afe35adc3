"""The bus as services see it, the same over Zenoh and within one process."""

from collections.abc import Callable, Collection
from typing import Protocol, TypeVar

from readygo.common.bus.identity import Member
from readygo.common.messages.topics import Live, Stream, Topic

Request = TypeVar("Request")
Reply = TypeVar("Reply")
Message = TypeVar("Message")


class Bus(Protocol):
    """One participant of a run: serves and asks topics, publishes and hears streams, sees who else is there.

    Everything that arrives is handled on one thread of the bus, in order of arrival, so handlers need no locks among
    themselves. Within one process requests are the exception: their handler runs on the asker's thread, before
    `request` returns, so that a run in one process takes the same steps every time.
    """

    def serve(
        self, topic: Topic[Request, Reply], handler: Callable[[Request], Reply], *, by: Collection[str] = ()
    ) -> None:
        """Answer requests on `topic` with `handler`.

        Args:
            topic: What is asked.
            handler: Answers.
            by: Roles whose certificates allow to ask, empty for all roles; where no certificates are used, every
                participant of the run may ask.
        """
        ...

    def request(self, topic: Topic[Request, Reply], request: Request, *, timeout_s: float = 5.0) -> Reply:
        """Ask `topic` and wait for the reply.

        Raises:
            PeerError: If the handler failed; the message names the topic and the reason.
            BusError: If no participant answers in time.
        """
        ...

    def publish(self, stream: Stream[Message], message: Message) -> None:
        """Give `message` to those who hear `stream` now, and return at once.

        A slow or dead subscriber costs nothing: what it cannot take is dropped. What must arrive is a request.
        """
        ...

    def tell(self, live: Live[Message], make: Callable[[], Message]) -> None:
        """Publish on this participant's own stream of a kind what `make` gives.

        No message is made before `announce` was called, without a subscriber, or before `Live.every_s` is over.
        """
        ...

    def subscribe(self, stream: Stream[Message], handler: Callable[[Message], None]) -> None:
        """Hear `stream`, in whose name "*" stands for any one part.

        Of what the handler has not come to yet, the newest `INBOX_MAX` messages wait.
        """
        ...

    def announce(self, role: str, name: str, *, turn: int = 0, replaced: Callable[[], object] | None = None) -> str:
        """Say that worker `name` of `role` is alive, until the bus is closed or the process dies.

        Args:
            role: What it does.
            name: Its name.
            turn: Number of this holder of the name; of several in succession, the later one has the higher.
            replaced: Called, on any thread, when one of a higher turn is there: this one was cut off, taken for dead,
                and is reached again.

        Returns:
            The session: what tells this presence from earlier and later ones of the same role and name.

        Raises:
            BusError: If another process has the name.
        """
        ...

    def watch(self, changed: Callable[[Member, bool], None]) -> None:
        """Call `changed(member, alive)` for every worker that is there, comes or goes."""
        ...

    def close(self) -> None:
        """Finish what has arrived, then leave."""
        ...
