import time
from contextlib import closing

import pytest

from readygo.common.bus.foreign import ForeignSession
from readygo.common.bus.zenoh_bus import Router, free_endpoint
from readygo.common.errors import BusError


def test_bytes_attachments_and_tokens_pass_as_they_are():
    endpoint, heard = free_endpoint(), []
    with (
        closing(Router(endpoint)),
        closing(ForeignSession(endpoint)) as one,
        closing(ForeignSession(endpoint)) as other,
    ):
        publisher = one.publisher("0/odom/x")
        assert not publisher.heard()
        other.hear("0/odom/*", lambda *message: heard.append(message))
        assert publisher.heard(5.0)
        publisher.put(b"\x00\x01", b"beside")
        until_s = time.monotonic() + 5.0
        while not heard and time.monotonic() < until_s:
            time.sleep(0.01)
        assert heard == [("0/odom/x", b"\x00\x01", b"beside")]
        one.announce("@ros2_lv/0/node")
        until_s = time.monotonic() + 5.0
        while not other.present("@ros2_lv/0/**") and time.monotonic() < until_s:
            time.sleep(0.01)
        assert other.present("@ros2_lv/0/**") == ["@ros2_lv/0/node"]
        assert one.name != other.name


def test_network_that_is_not_there_is_said():
    with pytest.raises(BusError, match="No Zenoh router answers at tcp/127"):
        ForeignSession(free_endpoint())
