import threading
import time
from collections.abc import Iterator

import pytest

from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.errors import BusError, RunError
from readygo.common.messages import PendingReply, PendingRequest

REQUEST = PendingRequest(recorder="rec0")


@pytest.fixture(scope="module")
def endpoint() -> Iterator[str]:
    router = Router(free_endpoint())
    yield router.endpoint
    router.close()


@pytest.fixture
def server(endpoint: str) -> Iterator[ZenohBus]:
    bus = ZenohBus(endpoint, "test")
    yield bus
    bus.close()


@pytest.fixture
def client(endpoint: str) -> Iterator[ZenohBus]:
    bus = ZenohBus(endpoint, "test")
    yield bus
    bus.close()


def test_request_is_answered_by_the_handler_of_its_topic(server: ZenohBus, client: ZenohBus) -> None:
    server.serve("a", PendingRequest, lambda request: PendingReply(indices=(len(request.recorder),)))
    assert client.request("a", REQUEST, PendingReply).indices == (4,)


def test_request_waits_for_a_server_that_starts_later(server: ZenohBus, client: ZenohBus) -> None:
    timer = threading.Timer(0.3, lambda: server.serve("late", PendingRequest, lambda _: PendingReply(indices=())))
    timer.start()
    assert client.request("late", REQUEST, PendingReply).indices == ()
    timer.join()


def test_failing_handler_answers_with_its_reason(server: ZenohBus, client: ZenohBus) -> None:
    def fail(_: PendingRequest) -> PendingReply:
        raise RunError("No space left in data.")

    server.serve("bad", PendingRequest, fail)
    with pytest.raises(BusError, match=r"bad: No space left in data\."):
        client.request("bad", REQUEST, PendingReply)


@pytest.mark.parametrize("slow", [True, False])
def test_silence_is_an_error_after_the_timeout(server: ZenohBus, client: ZenohBus, slow: bool) -> None:
    if slow:
        server.serve("silent", PendingRequest, lambda _: time.sleep(0.6))
    with pytest.raises(BusError, match=r"Nobody answered readygo/test/silent within 0\.3 s"):
        client.request("silent", REQUEST, PendingReply, timeout_s=0.3)


def test_runs_do_not_hear_each_other(endpoint: str, server: ZenohBus) -> None:
    server.serve("mine", PendingRequest, lambda _: PendingReply(indices=()))
    stranger = ZenohBus(endpoint, "another")
    with pytest.raises(BusError, match="Nobody answered"):
        stranger.request("mine", REQUEST, PendingReply, timeout_s=0.2)
    stranger.close()


def test_watcher_sees_workers_come_and_go(endpoint: str, server: ZenohBus) -> None:
    seen: list[tuple[str, str, bool]] = []
    gone = threading.Event()

    def changed(role: str, name: str, alive: bool) -> None:
        seen.append((role, name, alive))
        if not alive:
            gone.set()

    server.watch(changed)
    worker = ZenohBus(endpoint, "test")
    worker.announce("renderer", "r1")
    time.sleep(0.2)
    worker.close()
    assert gone.wait(5.0)
    assert seen == [("renderer", "r1", True), ("renderer", "r1", False)]


def test_port_in_use_is_said_in_one_line(endpoint: str) -> None:
    with pytest.raises(BusError, match=f"Cannot listen on {endpoint}: the port is in use"):
        Router(endpoint)


def test_absent_router_is_said_in_one_line() -> None:
    with pytest.raises(BusError, match=r"No router answers at .*: Unable to connect") as error:
        ZenohBus(free_endpoint(), "test")
    assert "\n" not in str(error.value)
