import dataclasses
import threading
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from typing import Any

import pytest
import zenoh

from readygo.common.bus import zenoh_bus
from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import _ASTRAY, Router, ZenohBus, free_endpoint
from readygo.common.errors import BusError, ConfigError, ReadygoError
from readygo.common.messages import PendingReply, PendingRequest, StatusReply, topics
from readygo.common.messages.codec import encode
from tests.apps.monitor.watched import status
from tests.common.messages.test_codec_fuzz import inputs
from tests.waiting import wait_for

REQUEST = PendingRequest(recorder="rec0")


def test_runs_do_not_hear_each_other() -> None:
    router = Router(free_endpoint())
    server, stranger = ZenohBus(router.endpoint, "mine"), ZenohBus(router.endpoint, "another")
    server.serve(topics.PENDING, lambda _: PendingReply(indices=()))
    with pytest.raises(BusError, match="No participant answered"):
        stranger.request(topics.PENDING, REQUEST, timeout_s=0.2)
    for bus in (stranger, server, router):
        bus.close()


def test_port_in_use_is_said_in_one_line() -> None:
    router = Router(free_endpoint())
    with pytest.raises(BusError, match=f"Cannot listen on {router.endpoint}: the port is in use"):
        Router(router.endpoint)
    router.close()


def test_absent_router_is_said_in_one_line() -> None:
    with pytest.raises(BusError, match=r"No router answers at .*: Unable to connect") as error:
        ZenohBus(free_endpoint(), "test")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("endpoint", ["foo", "tcp/127.0.0.1:99999", "tcp/", ""])
@pytest.mark.parametrize("opens", [Router, partial(ZenohBus, run="test"), ForeignSession])
def test_endpoint_that_is_none_is_refused_in_a_line(opens: Callable[[str], object], endpoint: str) -> None:
    with pytest.raises(ConfigError, match=r"of the form tcp/HOST:PORT") as error:
        opens(endpoint)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("opens", [Router, partial(ZenohBus, run="test"), ForeignSession])
def test_endpoint_that_zenoh_refuses_is_one_line(opens: Callable[[str], object]) -> None:
    for endpoint in ("ttt/127.0.0.1:7447", "tcp/127.0.0.1:7447?=#;;", "serial/#"):
        with pytest.raises(ReadygoError) as error:
            opens(endpoint)
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", ["\x1b[2J", "a/b", "*", "a#b", "", "x" * 201])
def test_name_that_cannot_be_shown_or_found_is_refused(name: str) -> None:
    router = Router(free_endpoint())
    bus = ZenohBus(router.endpoint, "test")
    with pytest.raises(BusError, match="choose another --name"):
        bus.announce("renderer", name)
    for each in (bus, router):
        each.close()


def test_tokens_with_names_that_cannot_be_shown_are_left_out() -> None:
    router = Router(free_endpoint())
    watcher, other = ZenohBus(router.endpoint, "test"), ZenohBus(router.endpoint, "test")
    seen: list[tuple[str, str, bool]] = []
    watcher.watch(lambda member, alive: seen.append((member.role, member.name, alive)))
    for role, name in (("renderer", "\x1b[2J"), ("\x9b", "b"), ("renderer", "last")):
        other._declared.append(other._session.liveliness().declare_token(f"readygo/test/alive/{role}/{name}/session"))
    wait_for(lambda: seen)
    assert seen == [("renderer", "last", True)]
    for each in (other, watcher, router):
        each.close()


def test_request_that_goes_astray_is_not_handled_and_sent_again() -> None:
    router = Router(free_endpoint())
    server, client = ZenohBus(router.endpoint, "test"), ZenohBus(router.endpoint, "test")
    handled: list[PendingRequest] = []
    server.serve(topics.PENDING, lambda request: handled.append(request) or PendingReply(indices=(3,)))
    assert client.request(topics.PENDING, REQUEST).indices == (3,)
    key = f"readygo/test/by/anonymous/{topics.PENDING.name}"
    for other in ({"attachment": b"coord/policy"}, {}):
        (reply,) = client._session.get(key, payload=encode(REQUEST), timeout=5.0, **other)
        assert reply.err.payload.to_bytes().decode() == _ASTRAY
    assert len(handled) == 1

    asked = []

    def at_second(query) -> None:
        asked.append(query.attachment.to_bytes().decode())
        if len(asked) == 1:
            query.reply_err(_ASTRAY.encode())
        else:
            query.reply(query.key_expr, encode(PendingReply(indices=(4,))))
        query.drop()

    server._declared.append(server._session.declare_queryable("readygo/test/by/*/" + topics.GRANT.name, at_second))
    grant = dataclasses.replace(topics.PENDING, name=topics.GRANT.name)
    assert client.request(grant, REQUEST).indices == (4,)
    assert asked == [topics.GRANT.name] * 2
    for bus in (client, server, router):
        bus.close()


def test_whoever_does_not_know_the_token_is_refused() -> None:
    router = Router(free_endpoint(), "secret")
    bus = ZenohBus(router.endpoint, "test", "secret")
    bus.serve(topics.PENDING, lambda request: PendingReply(indices=(3,)))
    for wrong in ("guess", ""):
        with pytest.raises(BusError, match=f"No router answers at {router.endpoint}"):
            ZenohBus(router.endpoint, "test", wrong)
    friend = ZenohBus(router.endpoint, "test", "secret")
    assert friend.request(topics.PENDING, REQUEST).indices == (3,)
    for each in (friend, bus, router):
        each.close()


def test_server_outlives_whatever_is_sent_to_it() -> None:
    router = Router(free_endpoint())
    server, client = ZenohBus(router.endpoint, "test"), ZenohBus(router.endpoint, "test")
    topics_of = {topic.request_type: topic for topic in (topics.PENDING, topics.GRANT, topics.append("r"))}
    for topic in topics_of.values():
        server.serve(topic, lambda request: PendingReply(indices=()))

    def replies(topic: topics.Topic[Any, Any], payload: bytes) -> list[zenoh.Reply]:
        key = f"readygo/test/by/anonymous/{topic.name}"
        return list(client._session.get(key, payload=payload, attachment=topic.name.encode(), timeout=20.0))

    for topic in topics_of.values():
        # The router tells clients of a new server a moment later; until then no one answers.
        assert any(replies(topic, b"") or time.sleep(0.05) for _ in range(200))
    sent = 0
    for cls, payload in inputs(3000, seed=1):
        if topic := topics_of.get(cls):
            (reply,) = replies(topic, payload)
            assert reply.ok or b"is no" in reply.err.payload.to_bytes()
            sent += 1
    assert sent > 100
    assert client.request(topics.PENDING, REQUEST).indices == ()
    for bus in (client, server, router):
        bus.close()


def test_message_of_another_version_is_one_line_and_no_obstacle(caplog: pytest.LogCaptureFixture) -> None:
    router = Router(free_endpoint())
    speaker, hearer = ZenohBus(router.endpoint, "test"), ZenohBus(router.endpoint, "test")
    heard: list[StatusReply] = []
    hearer.subscribe(topics.PROGRESS, heard.append)
    wait_for(lambda: speaker.heard(topics.PROGRESS))
    for _ in range(3):
        speaker._publisher(topics.PROGRESS).put(b"\x81\xa3new\x01")
    wait_for(lambda: speaker.publish(topics.PROGRESS, status()) or heard)
    (record,) = caplog.records
    assert "another version of readygo" in record.getMessage()
    assert record.exc_info is None
    for bus in (hearer, speaker, router):
        bus.close()


def test_name_that_several_want_at_once_gets_one_of_them(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(zenoh_bus, "_GONE_S", 1.0)
    router = Router(free_endpoint())
    buses = [ZenohBus(router.endpoint, "test") for _ in range(4)]
    start = threading.Barrier(len(buses))

    def announced(bus: ZenohBus) -> bool:
        start.wait()
        try:
            bus.announce("renderer", "r1")
        except BusError:
            return False
        return True

    with ThreadPoolExecutor(len(buses)) as pool:
        won = list(pool.map(announced, buses))
    assert won.count(True) == 1
    buses.pop(won.index(True)).close()
    buses[0].announce("renderer", "r1")
    for bus in (*buses, router):
        bus.close()


def test_who_does_not_get_a_name_is_not_seen_to_come_and_go() -> None:
    router = Router(free_endpoint())
    watcher, first, second = (ZenohBus(router.endpoint, "test") for _ in range(3))
    seen: list[tuple[str, str, bool]] = []
    watcher.watch(lambda member, alive: seen.append((member.role, member.name, alive)))
    first.announce("renderer", "r1")
    with pytest.raises(BusError, match="Another renderer of the run is called 'r1'"):
        second.announce("renderer", "r1")
    second.close()
    wait_for(lambda: seen)
    assert seen == [("renderer", "r1", True)]
    for bus in (first, watcher, router):
        bus.close()
