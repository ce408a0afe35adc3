import os
import sys
import threading
import time

import msgpack
import pytest

from readygo.benchmarks.recording import watching
from readygo.benchmarks.recording.watching import MonitorCost, Viewers, cpu_s, growth_mb_per_h, summary


def moments(private_mb, period_s=60.0):
    return [MonitorCost(k * period_s, size, 0.5 * k, 0.1 * k) for k, size in enumerate(private_mb)]


def test_growth_is_that_of_the_second_half() -> None:
    assert growth_mb_per_h(moments([10.0, 60.0, 99.0, 100.0, 100.0, 100.0, 100.0])) == pytest.approx(0.0, abs=1e-6)
    assert growth_mb_per_h(moments([100.0 + 2.0 * k for k in range(9)])) == pytest.approx(120.0)


def test_summary_tells_shares_and_ten_readings() -> None:
    told = summary(moments([float(k) for k in range(19)]), [2, 3])
    assert (told["minutes"], told["visits"], told["received_mb"]) == (18.0, 5, 1.8)
    assert told["cpu_share"] == round(9.0 / (18 * 60.0), 3)
    assert told["private_mb"] == [float(k) for k in range(0, 19, 2)]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_processor_time_of_a_process_is_read() -> None:
    assert 0.0 < cpu_s(os.getpid()) < 24 * 3600


@pytest.fixture
def page():
    """A page that says hello to who names a camera, then closes; its address and what it was told."""
    pytest.importorskip("viser", reason="viser (extra monitor) is not installed")
    from websockets.sync.server import serve

    heard = []

    def answer(visitor) -> None:
        heard.append(msgpack.unpackb(visitor.recv()))
        visitor.send(b"hello")

    def first(_, offered):
        return next(name for name in offered if name.startswith("viser-v"))

    with serve(answer, "127.0.0.1", 0, select_subprotocol=first) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield f"ws://127.0.0.1:{server.socket.getsockname()[1]}/", heard
        server.shutdown()
        thread.join()


def test_viewers_come_again_when_the_page_goes_away(page) -> None:
    address, heard = page
    viewers = Viewers(address, 2)
    until = time.monotonic() + 30.0
    while min(viewers.visits) < 2 and time.monotonic() < until:
        time.sleep(0.02)
    viewers.close()
    assert min(viewers.visits) >= 2
    assert min(viewers.received) >= len(b"hello")
    assert all(told["type"] == "ViewerCameraMessage" for told in heard)


def test_viewers_wait_for_a_page_that_is_not_there() -> None:
    pytest.importorskip("viser", reason="viser (extra monitor) is not installed")
    viewers = Viewers("ws://127.0.0.1:9/", 1)
    viewers.close()
    assert viewers.visits == [0]


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="reads /proc")
def test_monitor_that_ends_at_once_ends_the_measurement(monkeypatch, tmp_path) -> None:
    monkeypatch.setattr(watching, "PERIOD_S", 0.2)
    with pytest.raises(SystemExit):
        watching.main(tmp_path / "nothing", minutes=1.0, viewers=0)
