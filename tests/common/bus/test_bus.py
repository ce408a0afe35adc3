"""What every bus keeps to: one suite, over Zenoh and within one process."""

import queue
import threading
import time
from collections.abc import Callable, Iterator

import pytest

from readygo.common.bus import Bus, InProcessBus
from readygo.common.bus.inbox import INBOX_MAX
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.errors import BusError, PeerError, RunError
from readygo.common.messages import BlobReply, PendingReply, PendingRequest
from readygo.common.messages.topics import Live, Stream, Topic
from tests.waiting import wait_for

Join = Callable[[], Bus]
QUESTION = Topic("question", PendingRequest, PendingReply)
OTHER = Topic("other", PendingRequest, PendingReply)
NEWS = Stream("live/news", BlobReply)
FLASH = Live("flash", BlobReply)
REQUEST = PendingRequest(recorder="rec0")
REPLY = PendingReply(indices=(4,))


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    router = Router(free_endpoint())
    yield router.endpoint
    router.close()


@pytest.fixture(params=["zenoh", "in-process"])
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


@pytest.fixture
def join(kind: str, request: pytest.FixtureRequest) -> Iterator[Join]:
    """Another participant of one run."""
    joined: list[Bus] = []
    endpoint = request.getfixturevalue("endpoint") if kind == "zenoh" else ""

    def make() -> Bus:
        beside = joined[0] if joined else None
        bus = ZenohBus(endpoint, request.node.name) if kind == "zenoh" else InProcessBus(beside)  # type: ignore[arg-type]
        joined.append(bus)
        return bus

    yield make
    for bus in joined:
        bus.close()


@pytest.fixture
def server(join: Join) -> Bus:
    return join()


@pytest.fixture
def client(server: Bus, join: Join) -> Bus:
    return join()


def news(number: int, data: bytes = b"") -> BlobReply:
    return BlobReply(size=number, data=data)


def heard_by(publisher: Bus, subscriber: Bus, handler: Callable[[BlobReply], None]) -> None:
    """Subscribe, and wait until the publisher knows."""
    knows = threading.Event()

    def handle(message: BlobReply) -> None:
        if message.size < 0:
            knows.set()
        else:
            handler(message)

    subscriber.subscribe(NEWS, handle)

    def reached() -> bool:
        publisher.publish(NEWS, news(-1))
        return knows.wait(0.01)

    wait_for(reached)


def test_request_is_answered_by_the_handler_of_its_topic(server: Bus, client: Bus) -> None:
    server.serve(QUESTION, lambda request: PendingReply(indices=(len(request.recorder),)))
    server.serve(OTHER, lambda request: PendingReply(indices=()))
    assert client.request(QUESTION, REQUEST) == REPLY


def test_own_requests_are_answered_too(server: Bus) -> None:
    server.serve(QUESTION, lambda _: REPLY)
    assert server.request(QUESTION, REQUEST) == REPLY


def test_failing_handler_answers_with_its_reason_and_goes_on(server: Bus, client: Bus) -> None:
    failures: list[Exception] = [RunError("No space left in data."), ValueError("no floor")]

    def fail(_: PendingRequest) -> PendingReply:
        if failures:
            raise failures.pop(0)
        return REPLY

    server.serve(QUESTION, fail)
    with pytest.raises(PeerError, match=r"^question: No space left in data\.$"):
        client.request(QUESTION, REQUEST)
    with pytest.raises(PeerError, match=r"^question: ValueError: no floor$"):
        client.request(QUESTION, REQUEST)
    assert client.request(QUESTION, REQUEST) == REPLY


def test_silence_is_an_error_but_no_answer(client: Bus) -> None:
    with pytest.raises(BusError, match=r"No participant answered .*question") as error:
        client.request(QUESTION, REQUEST, timeout_s=0.2)
    assert not isinstance(error.value, PeerError)


def test_server_that_left_does_not_answer(join: Join, client: Bus) -> None:
    server = join()
    server.serve(QUESTION, lambda _: REPLY)
    assert client.request(QUESTION, REQUEST) == REPLY
    server.close()
    with pytest.raises(BusError, match="No participant answered"):
        client.request(QUESTION, REQUEST, timeout_s=0.2)


def test_subscribers_hear_what_is_published_in_order(server: Bus, client: Bus, join: Join) -> None:
    heard: dict[str, list[BlobReply]] = {"client": [], "third": []}
    heard_by(server, client, heard["client"].append)
    heard_by(server, join(), heard["third"].append)
    for number in range(5):
        server.publish(NEWS, news(number, b"x" * number))
    for messages in heard.values():
        wait_for(lambda messages=messages: len(messages) == 5)
        assert messages == [news(number, b"x" * number) for number in range(5)]


def test_large_messages_come_through_at_an_easy_pace(server: Bus, client: Bus) -> None:
    heard: list[BlobReply] = []
    heard_by(server, client, heard.append)
    for number in range(1, 4):
        server.publish(NEWS, news(number, bytes(1_000_000 * number)))
        time.sleep(0.3)
    # A busy machine may lose one: the stream is lossy.
    wait_for(lambda: len(heard) >= 2)
    assert all(len(message.data) == 1_000_000 * message.size for message in heard)


def test_message_that_nobody_hears_costs_nothing(server: Bus, client: Bus, monkeypatch: pytest.MonkeyPatch) -> None:
    encoded: list[object] = []
    monkeypatch.setattr("readygo.common.bus.zenoh_bus.encode", encoded.append)
    client.subscribe(Stream("live/else", BlobReply), encoded.append)
    for number in range(3):
        server.publish(NEWS, news(number))
    assert encoded == []


def test_slow_subscriber_costs_the_publisher_nothing_and_hears_the_newest(server: Bus, client: Bus) -> None:
    numbers: list[int] = []
    inside, gate = threading.Event(), threading.Event()

    def slow(message: BlobReply) -> None:
        inside.set()
        gate.wait(10.0)
        numbers.append(message.size)

    heard_by(server, client, slow)
    server.publish(NEWS, news(0))
    assert inside.wait(5.0)
    begin_s = time.monotonic()
    for number in range(1, 301):
        server.publish(NEWS, news(number, b"x" * 20_000))
    assert time.monotonic() - begin_s < 2.0
    # The way may have been full: what comes at an easy pace gets through, and pushes out what is older.
    for number in range(301, 301 + 3 * INBOX_MAX):
        server.publish(NEWS, news(number))
        time.sleep(0.005)
    # Nothing is to be on its way any more that would come once there is room again.
    time.sleep(1.0)
    gate.set()
    wait_for(lambda: len(numbers) > 1)
    time.sleep(0.1)
    assert numbers == sorted(numbers)
    assert len(numbers) <= 1 + INBOX_MAX
    assert numbers[1] > 300


def test_failing_subscriber_hears_the_next_message(server: Bus, client: Bus) -> None:
    heard: list[int] = []

    def fragile(message: BlobReply) -> None:
        heard.append(message.size)
        raise ValueError("once")

    heard_by(server, client, fragile)
    for number in range(2):
        server.publish(NEWS, news(number))
    wait_for(lambda: heard == [0, 1])


def test_watcher_sees_who_is_there_and_who_comes_and_goes(server: Bus, join: Join) -> None:
    seen: list[tuple[str, str, bool]] = []
    early = join()
    early.announce("animator", "a1")
    server.watch(lambda member, alive: seen.append((member.role, member.name, alive)))
    wait_for(lambda: seen == [("animator", "a1", True)])
    late = join()
    late.announce("renderer", "r1")
    wait_for(lambda: seen[1:] == [("renderer", "r1", True)])
    early.close()
    wait_for(lambda: seen[2:] == [("animator", "a1", False)])
    late.close()
    wait_for(lambda: seen[3:] == [("renderer", "r1", False)])


def test_everything_that_arrives_is_handled_on_one_thread(server: Bus, client: Bus, join: Join, kind: str) -> None:
    threads: dict[str, int] = {}

    def note(what: str) -> None:
        threads[what] = threading.get_ident()

    server.serve(QUESTION, lambda _: note("request") or REPLY)  # type: ignore[func-returns-value]
    server.watch(lambda *_: note("presence"))
    heard_by(client, server, lambda _: note("message"))
    client.publish(NEWS, news(0))
    client.request(QUESTION, REQUEST)
    client.announce("renderer", "r1")
    wait_for(lambda: len(threads) == 3)
    assert threads["message"] == threads["presence"] != threading.get_ident()
    # Within one process the asker's thread does the work: a run takes the same steps every time.
    assert threads["request"] == (threads["message"] if kind == "zenoh" else threading.get_ident())


@pytest.mark.parametrize("kind", ["zenoh"], indirect=False)
def test_request_waits_for_a_server_that_starts_later(server: Bus, client: Bus) -> None:
    timer = threading.Timer(0.3, lambda: server.serve(QUESTION, lambda _: REPLY))
    timer.start()
    assert client.request(QUESTION, REQUEST) == REPLY
    timer.join()


@pytest.mark.parametrize("kind", ["zenoh"], indirect=False)
def test_handler_that_takes_too_long_is_silence(server: Bus, client: Bus) -> None:
    server.serve(QUESTION, lambda _: time.sleep(0.6) or REPLY)  # type: ignore[func-returns-value]
    with pytest.raises(BusError, match=r"No participant answered readygo/.*/question within 0\.3 s"):
        client.request(QUESTION, REQUEST, timeout_s=0.3)


def test_stars_stand_for_one_part_of_a_streams_name(server: Bus, client: Bus) -> None:
    heard: queue.SimpleQueue[BlobReply] = queue.SimpleQueue()
    client.subscribe(FLASH.of(), heard.put)
    server.announce("renderer", "r0")
    news = BlobReply(size=3, data=b"abc")
    deadline_s = time.monotonic() + 10
    while heard.empty() and time.monotonic() < deadline_s:
        server.tell(FLASH, lambda: news)
        time.sleep(0.02)
    assert heard.get(timeout=1) == news


def test_nobody_hears_what_nobody_subscribed_to(server: Bus, client: Bus) -> None:
    client.subscribe(NEWS, lambda news: None)
    server.announce("renderer", "r0")
    server.tell(FLASH, lambda: pytest.fail("made for nobody"))


def test_each_life_of_a_worker_has_a_session_of_its_own(join: Join) -> None:
    server = join()
    seen: list[tuple[str, bool]] = []
    server.watch(lambda member, alive: seen.append((member.session, alive)))
    sessions = []
    for _ in range(2):
        worker = join()
        sessions.append(worker.announce("renderer", "r1"))
        worker.close()
    first, second = sessions
    assert first != second
    wait_for(lambda: seen == [(first, True), (first, False), (second, True), (second, False)])
