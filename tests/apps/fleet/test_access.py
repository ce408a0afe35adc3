import os
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

pytest.importorskip("cryptography", reason="needs the extra tls")

from readygo.apps.fleet.access import (
    how_to_join,
    identity_for,
    join,
    join_in_time,
    open_router,
    reached_here,
    refusals_on_stderr,
)
from readygo.apps.fleet.certificates import issue, make_authority
from readygo.common.bus.zenoh_bus import Router, free_endpoint
from readygo.common.errors import BusError, CertificateError, PeerError
from readygo.common.messages import RunSpecRequest, topics
from tests.common.messages.run_specs import SPEC


def test_tls_takes_certificates_and_tcp_takes_none(tmp_path: Path) -> None:
    with pytest.raises(CertificateError, match=r"Endpoint tls/lab:7447 needs certificates: pass --certs\."):
        join("tls/lab:7447", "run", "renderer")
    with pytest.raises(CertificateError, match=r"Endpoint tcp/lab:7447 has no use for certificates: name it tls/"):
        join("tcp/lab:7447", "run", "renderer", certs=tmp_path)
    assert identity_for("tcp/127.0.0.1:1", "renderer") is None


def test_recorder_shows_the_certificate_of_its_name(tmp_path: Path) -> None:
    make_authority(tmp_path)
    issue(tmp_path, tmp_path, "recorder.rec1")
    identity = identity_for("tls/lab:7447", "recorder", name="rec1", certs=tmp_path)
    assert identity is not None
    assert identity.name == "recorder.rec1"
    with pytest.raises(CertificateError, match=r"has no certificate of recorder\.rec0 \(it has recorder\.rec1\)"):
        identity_for("tls/lab:7447", "recorder", name="rec0", certs=tmp_path)


def test_router_of_a_run_is_opened_and_joined_with_certificates_or_the_token(tmp_path: Path) -> None:
    make_authority(tmp_path)
    for name in ("coordinator", "renderer"):
        issue(tmp_path, tmp_path, name, hosts=("127.0.0.1",))
    for kind, certs in (("tls/", tmp_path), ("tcp/", None)):
        endpoint = free_endpoint().replace("tcp/", kind)
        router = open_router(("rec0",), endpoint, certs=certs, token="secret")
        coordinator, renderer = (
            join(endpoint, "test", role, certs=certs, token="secret") for role in ("coordinator", "renderer")
        )
        coordinator.serve(topics.SPEC, lambda _: SPEC)
        assert renderer.request(topics.SPEC, RunSpecRequest(role="renderer")) == SPEC
        if certs:
            with pytest.raises(PeerError, match="a certificate of 'renderer' does not allow to join as animator"):
                renderer.request(topics.SPEC, RunSpecRequest(role="animator"))
        else:
            with pytest.raises(BusError, match="No router answers"):
                join(endpoint, "test", "renderer", token="guessed")
        for each in (renderer, coordinator, router):
            each.close()


def test_router_that_is_not_up_yet_is_waited_for_with_one_line(caplog: pytest.LogCaptureFixture) -> None:
    endpoint, told = free_endpoint(), threading.Event()
    caplog.handler.addFilter(lambda record: told.set() or True)
    with ThreadPoolExecutor() as pool:
        joining = pool.submit(join_in_time, endpoint, "test", "renderer", threading.Event())
        assert told.wait(60)
        router = Router(endpoint)
        joining.result(60).close()
        router.close()
    (line,) = caplog.records
    assert line.message.startswith(f"No router answers at {endpoint}, or it wants the run's token: ")


def test_worker_that_is_told_to_end_waits_for_no_router() -> None:
    stop = threading.Event()
    stop.set()
    with pytest.raises(BusError, match="No router answers"):
        join_in_time(free_endpoint(), "test", "renderer", stop)


def test_machine_reaches_its_own_router_by_loopback() -> None:
    assert reached_here("tls/0.0.0.0:7447") == "tls/127.0.0.1:7447"
    assert reached_here("tls/[::]:7447") == "tls/[::1]:7447"
    assert reached_here("tls/10.0.0.5:7447") == "tls/10.0.0.5:7447"


def test_what_a_router_says_does_not_mix_with_what_a_command_prints(capfd: pytest.CaptureFixture[str]) -> None:
    with refusals_on_stderr():
        os.write(1, b"refused\n")
    os.write(1, b"result\n")
    assert capfd.readouterr() == ("result\n", "refused\n")


def test_further_workers_are_told_how_to_join(tmp_path: Path) -> None:
    command = "readygo worker renderer --connect tcp/lab:7447 --run lab"
    open_to_the_owner = how_to_join(tmp_path, "renderer", "tcp/lab:7447", " --run lab", certs=None)
    assert open_to_the_owner == f"More workers can join: READYGO_TOKEN=$(tail -1 {tmp_path / 'endpoint'}) {command}"
    certified = how_to_join(tmp_path, "renderer", "tcp/lab:7447", " --run lab", certs=tmp_path)
    assert certified == f"More workers can join: {command} --certs CERTS"
