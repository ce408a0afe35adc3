"""The bus within one process: no bytes, requests are calls."""

import itertools
import logging
from collections.abc import Callable, Collection, Iterator
from dataclasses import dataclass, field
from typing import Any, TypeVar

from readygo.common.bus.identity import Member
from readygo.common.bus.inbox import Inbox, Mailbox
from readygo.common.bus.teller import Teller
from readygo.common.errors import BusError, PeerError, ReadygoError, reason
from readygo.common.messages.topics import Live, Stream, Topic, matches

Request = TypeVar("Request")
Reply = TypeVar("Reply")
Message = TypeVar("Message")

log = logging.getLogger(__name__)


@dataclass
class _Room:
    """What the participants of one run know of each other."""

    handlers: dict[str, Callable[[Any], Any]] = field(default_factory=dict)
    mailboxes: list[tuple[str, Mailbox[Any]]] = field(default_factory=list)
    watchers: list[Callable[[Member, bool], None]] = field(default_factory=list)
    present: list[Member] = field(default_factory=list)
    sessions: Iterator[int] = field(default_factory=itertools.count)


class InProcessBus:
    """Calls the handler of a topic directly with the request object; see `readygo.common.bus.Bus`."""

    def __init__(self, beside: "InProcessBus | None" = None) -> None:
        """Take part in a new run, or in that of another bus of this process."""
        self._room: _Room = _Room() if beside is None else beside._room
        self._inbox = Inbox()
        self._teller = Teller(self)
        self._leave: list[Callable[[], object]] = []

    def serve(
        self, topic: Topic[Request, Reply], handler: Callable[[Request], Reply], *, by: Collection[str] = ()
    ) -> None:
        """Answer requests on `topic` with `handler`, on the asker's thread."""
        self._room.handlers[topic.name] = handler
        self._leave.append(lambda: self._room.handlers.pop(topic.name, None))

    def request(self, topic: Topic[Request, Reply], request: Request, *, timeout_s: float = 5.0) -> Reply:
        """Ask `topic` as `Bus.request` does; no participant can join while the asker waits, so it does not wait."""
        handler = self._room.handlers.get(topic.name)
        if handler is None:
            served = ", ".join(sorted(self._room.handlers)) or "nothing"
            raise BusError(f"No participant answered {topic.name}; served: {served}.")
        try:
            reply = handler(request)
        except Exception as error:
            if not isinstance(error, ReadygoError):
                log.exception("%s", topic.name)
            raise PeerError(f"{topic.name}: {reason(error)}") from error
        assert isinstance(reply, topic.reply_type), f"{topic.name} answered {type(reply).__name__}"
        return reply

    def publish(self, stream: Stream[Message], message: Message) -> None:
        """Give `message` to those who hear `stream`; see `Bus.publish`."""
        for name, mailbox in tuple(self._room.mailboxes):
            if matches(name, stream.name):
                mailbox.put(message)

    def heard(self, stream: Stream[Message]) -> bool:
        """True if a subscriber listens to `stream`."""
        return any(matches(name, stream.name) for name, _ in tuple(self._room.mailboxes))

    def tell(self, live: Live[Message], make: Callable[[], Message]) -> None:
        """Show what is under way; see `Bus.tell`."""
        self._teller.tell(live, make)

    def subscribe(self, stream: Stream[Message], handler: Callable[[Message], None]) -> None:
        """Hear `stream`; see `Bus.subscribe`."""
        self._add(self._room.mailboxes, (stream.name, Mailbox(self._inbox, handler)))

    def announce(self, role: str, name: str, *, turn: int = 0, replaced: Callable[[], object] | None = None) -> str:
        """Say that a worker is alive, as `Bus.announce` does; within a process no participant can be cut off."""
        self._teller.me = role, name
        member = Member(role, name, str(next(self._room.sessions)))
        self._room.present.append(member)
        self._tell(member, True)
        self._leave.append(lambda: self._depart(member))
        return member.session

    def watch(self, changed: Callable[[Member, bool], None]) -> None:
        """Hear of workers; see `Bus.watch`."""

        def deliver_change(member: Member, alive: bool) -> None:
            self._inbox.put(lambda: changed(member, alive))

        for member in self._room.present:
            deliver_change(member, True)
        self._add(self._room.watchers, deliver_change)

    def close(self) -> None:
        """Leave the run."""
        while self._leave:
            self._leave.pop()()
        self._inbox.close()

    def _add(self, members: list[Any], member: Any) -> None:
        members.append(member)
        self._leave.append(lambda: members.remove(member))

    def _depart(self, member: Member) -> None:
        self._room.present.remove(member)
        self._tell(member, False)

    def _tell(self, member: Member, alive: bool) -> None:
        for watcher in tuple(self._room.watchers):
            watcher(member, alive)
