import pytest

from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.errors import BusError
from readygo.common.messages import PendingReply, PendingRequest, topics

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
