from pathlib import Path

import pytest

from readygo.apps.monitor import link as linking
from readygo.apps.monitor.link import Link, RunAddress, address_of
from readygo.apps.monitor.watch import RunWatch
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.errors import BusError, CertificateError, RunError
from readygo.common.messages import RunSpec, topics
from readygo.runs.folder import RunFolder
from tests.apps.monitor.watched import status
from tests.common.bus.certified import certificates, certified_router
from tests.waiting import wait_for

TOKEN = "ab12"


@pytest.fixture
def router():
    router = Router(free_endpoint(), TOKEN)
    yield router
    router.close()


def fleet(router: Router, spec: RunSpec | None) -> ZenohBus:
    bus = ZenohBus(router.endpoint, "run-a", TOKEN)

    def serve(_: object) -> RunSpec:
        if spec is None:
            raise BusError("field stages is missing")
        return spec

    bus.serve(topics.SPEC, serve)
    return bus


def test_wrong_host_wrong_run_and_another_version_say_so(router: Router, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linking, "SPEC_TIMEOUT_S", 0.5)

    def join(endpoint: str, run: str) -> None:
        Link(RunWatch(), lambda: RunAddress(endpoint, run, TOKEN)).join()

    with pytest.raises(BusError, match="No router answers at"):
        join(free_endpoint(), "run-a")
    with pytest.raises(BusError, match="no run 'run-b' is there"):
        join(router.endpoint, "run-b")
    bus = fleet(router, None)
    with pytest.raises(BusError, match="another version of readygo"):
        join(router.endpoint, "run-a")
    bus.close()


def test_a_run_is_joined_lost_and_joined_again(router: Router, spec: RunSpec, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(linking, "RETRY_S", 0.1)
    monkeypatch.setattr(linking, "SILENT_S", 1.0)
    monkeypatch.setattr(linking, "SPEC_TIMEOUT_S", 1.0)
    watch = RunWatch()
    link = Link(watch, lambda: RunAddress(router.endpoint, "run-a", TOKEN))
    bus = fleet(router, spec)
    link.start()

    def heard(samples: int) -> bool:
        bus.publish(topics.PROGRESS, status(samples=samples))
        return watch.status is not None and watch.status.samples == samples

    wait_for(lambda: heard(1))
    assert watch.spec is not None
    assert watch.spec.seed == spec.seed
    bus.close()
    wait_for(lambda: watch.connection)
    bus = fleet(router, spec)
    wait_for(lambda: heard(2))
    assert watch.connection == ""
    link.close()
    bus.close()


def test_folder_says_where_its_fleet_is(tmp_path: Path, spec: RunSpec) -> None:
    folder = RunFolder(tmp_path)
    folder.state.mkdir()
    folder.save(spec, 3)
    with pytest.raises(RunError, match="No fleet is at work"):
        address_of(folder)
    with folder.reachable("tcp/127.0.0.1:7447", TOKEN):
        assert address_of(folder) == ("tcp/127.0.0.1:7447", spec.run, TOKEN, None)


def test_run_that_wants_certificates_is_joined_as_monitor(tmp_path: Path, spec: RunSpec) -> None:
    pytest.importorskip("cryptography", reason="needs the extra tls")
    certificates(tmp_path, "coordinator", "monitor")
    with certified_router(tmp_path) as (endpoint, join):
        join("coordinator").serve(topics.SPEC, lambda _: spec)
        link = Link(RunWatch(), lambda: RunAddress(endpoint, "test", "", tmp_path))
        assert link.join().seed == spec.seed
        link.close()
        with pytest.raises(CertificateError, match="--certs"):
            Link(RunWatch(), lambda: RunAddress(endpoint, "test", "")).join()
