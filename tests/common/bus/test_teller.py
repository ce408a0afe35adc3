from typing import Any

from readygo.common.bus.teller import Teller
from readygo.common.messages import BlobReply
from readygo.common.messages.topics import Live, Stream

NEWS = Live("news", BlobReply, every_s=0.2)
REPLY = BlobReply(size=1, data=b"x")


class Listened:
    """A bus that somebody hears, or nobody."""

    def __init__(self) -> None:
        self.heard_now, self.published = True, list[str]()

    def heard(self, stream: Stream[Any]) -> bool:
        return self.heard_now

    def publish(self, stream: Stream[Any], message: Any) -> None:
        self.published.append(stream.name)


def test_nothing_is_made_while_nobody_listens_or_knows_who_this_is() -> None:
    bus, made = Listened(), list[int]()
    teller = Teller(bus, clock=lambda: 0.0)

    def make() -> BlobReply:
        made.append(1)
        return REPLY

    teller.tell(NEWS, make)
    teller.me, bus.heard_now = ("renderer", "r0"), False
    teller.tell(NEWS, make)
    assert made == []
    bus.heard_now = True
    teller.tell(NEWS, make)
    assert bus.published == ["live/renderer/r0/news"]


def test_messages_keep_their_distance() -> None:
    bus, now_s = Listened(), [0.0]
    teller = Teller(bus, clock=lambda: now_s[0])
    teller.me = "renderer", "r0"
    for step in range(20):
        now_s[0] = 0.05 * step + 1e-6 * step
        teller.tell(NEWS, lambda: REPLY)
    assert len(bus.published) == 5


def test_message_comes_again_when_its_time_has_passed_and_each_kind_has_its_own() -> None:
    bus, now_s = Listened(), [10.0]
    teller, other = Teller(bus, clock=lambda: now_s[0]), Live("other", BlobReply, every_s=0.25)
    teller.me = "renderer", "r0"
    for at_s, live in ((10.0, other), (10.0, NEWS), (10.0, other), (10.125, other), (10.25, other), (10.375, other)):
        now_s[0] = at_s
        teller.tell(live, lambda: REPLY)
    assert bus.published == ["live/renderer/r0/other", "live/renderer/r0/news", "live/renderer/r0/other"]
    bus.heard_now = False
    now_s[0] = 20.0
    teller.tell(NEWS, lambda: REPLY)
    bus.heard_now = True
    teller.tell(NEWS, lambda: REPLY)
    assert bus.published[-1] == "live/renderer/r0/news", "what nobody heard does not count"
