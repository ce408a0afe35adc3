"""What the bus within one process does beyond the suite that both buses pass: see test_bus.py."""

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.errors import BusError, PeerError
from readygo.common.messages import BlobReply, PendingReply, PendingRequest
from readygo.common.messages.topics import Stream, Topic

QUESTION = Topic("question", PendingRequest, PendingReply)
OTHER = Topic("other", PendingRequest, PendingReply)
REQUEST = PendingRequest(recorder="rec0")
REPLY = PendingReply(indices=(4,))


def test_messages_are_handed_over_as_they_are() -> None:
    bus, asked = InProcessBus(), []
    bus.serve(QUESTION, lambda request: asked.append(request) or REPLY)
    assert bus.request(QUESTION, REQUEST) is REPLY
    assert asked[0] is REQUEST


def test_silence_names_what_is_served() -> None:
    bus = InProcessBus()
    with pytest.raises(BusError, match=r"No participant answered question; served: nothing\."):
        bus.request(QUESTION, REQUEST)
    for topic in (QUESTION, OTHER):
        bus.serve(topic, lambda _: REPLY)
    with pytest.raises(BusError, match=r"No participant answered third; served: other, question\."):
        bus.request(Topic("third", PendingRequest, PendingReply), REQUEST)


def test_reply_of_another_type_is_our_bug() -> None:
    bus = InProcessBus()
    bus.serve(QUESTION, lambda _: BlobReply(size=0, data=b""))
    with pytest.raises(AssertionError, match="question answered BlobReply"):
        bus.request(QUESTION, REQUEST)


def test_unforeseen_failure_is_logged_with_its_traceback(caplog: pytest.LogCaptureFixture) -> None:
    bus = InProcessBus()
    bus.serve(QUESTION, lambda _: 1 // 0)
    with pytest.raises(PeerError, match="question: ZeroDivisionError"):
        bus.request(QUESTION, REQUEST)
    assert [(record.message, record.exc_info is not None) for record in caplog.records] == [("question", True)]


def test_runs_do_not_hear_each_other() -> None:
    bus, other, heard = InProcessBus(), InProcessBus(), []
    news = Stream("live/news", BlobReply)
    other.subscribe(news, heard.append)
    bus.publish(news, BlobReply(size=0, data=b""))
    bus.serve(QUESTION, lambda _: REPLY)
    with pytest.raises(BusError, match="served: nothing"):
        other.request(QUESTION, REQUEST)
    other.close()
    assert heard == []


def test_who_has_left_hears_nothing_more_and_is_not_there() -> None:
    bus = InProcessBus()
    guest, heard, present = InProcessBus(beside=bus), [], []
    news = Stream("live/news", BlobReply)
    guest.subscribe(news, heard.append)
    guest.announce("animator", "a1")
    bus.announce("renderer", "r1")
    bus.publish(news, BlobReply(size=1, data=b""))
    guest.close()
    bus.publish(news, BlobReply(size=2, data=b""))
    bus.watch(lambda member, alive: present.append((member.role, member.name, alive)))
    bus.close()
    assert [message.size for message in heard] == [1]
    assert present == [("renderer", "r1", True)]
