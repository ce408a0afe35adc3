import dataclasses

import pytest

from readygo.common.bus.zenoh_bus import _ASTRAY, Router, ZenohBus, free_endpoint
from readygo.common.errors import BusError
from readygo.common.messages import PendingReply, PendingRequest, topics
from readygo.common.messages.codec import encode

REQUEST = PendingRequest(recorder="rec0")


def test_runs_do_not_hear_each_other() -> None:
    router = Router(free_endpoint())
    server, stranger = ZenohBus(router.endpoint, "mine"), ZenohBus(router.endpoint, "another")
    server.serve(topics.PENDING, lambda _: PendingReply(indices=()))
    with pytest.raises(BusError, match="Nobody answered"):
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


def test_request_that_goes_astray_is_not_handled_and_sent_again() -> None:
    router = Router(free_endpoint())
    server, client = ZenohBus(router.endpoint, "test"), ZenohBus(router.endpoint, "test")
    handled: list[PendingRequest] = []
    server.serve(topics.PENDING, lambda request: handled.append(request) or PendingReply(indices=(3,)))
    assert client.request(topics.PENDING, REQUEST).indices == (3,)
    key = f"readygo/test/{topics.PENDING.name}"
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

    server._declared.append(server._session.declare_queryable("readygo/test/" + topics.GRANT.name, at_second))
    grant = dataclasses.replace(topics.PENDING, name=topics.GRANT.name)
    assert client.request(grant, REQUEST).indices == (4,)
    assert asked == [topics.GRANT.name] * 2
    for bus in (client, server, router):
        bus.close()
