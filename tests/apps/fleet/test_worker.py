from collections.abc import Iterator
from pathlib import Path

import pytest

from readygo.apps.fleet import access
from readygo.apps.fleet.fleet import CANNOT_WORK
from readygo.apps.fleet.worker import worker
from readygo.common.bus.zenoh_bus import Router, ZenohBus, free_endpoint
from readygo.common.errors import BusError
from readygo.common.messages import topics
from tests.common.messages.run_specs import SPEC


@pytest.fixture
def endpoint() -> Iterator[str]:
    router = Router(free_endpoint())
    bus = ZenohBus(router.endpoint, "run-test")
    bus.serve(topics.SPEC, lambda _: SPEC)
    yield router.endpoint
    bus.close()
    router.close()


@pytest.fixture(autouse=True)
def _signals_stay(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("readygo.apps.fleet.process.signal.signal", lambda *_: None)
    # Kernels are not what these tests are about, and nor is who made the run.
    monkeypatch.setattr("readygo.apps.run.warm.warm_once", lambda *_: None)
    monkeypatch.setattr("readygo.apps.fleet.worker.check_same_make", lambda *_: None)


def test_worker_that_somebody_must_help_ends_with_a_code_of_its_own(
    endpoint: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for role, options, words in (
        ("recorder", {}, "A recorder needs the run's data folder: pass --data."),
        ("coordinator", {"data": (tmp_path,)}, f"{tmp_path} is no data folder of a run"),
        ("juggler", {}, "The run has nothing to do for a 'juggler'; its stages need: human-planner, animator, robot-"),
    ):
        with pytest.raises(SystemExit) as exit_info:
            worker(role, connect=endpoint, run="run-test", **options)
        assert exit_info.value.code == CANNOT_WORK == 78
        assert capsys.readouterr().err.splitlines()[-1].startswith(f"readygo: {words}")


def test_worker_without_a_bus_may_try_again(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(access, "ROUTER_ABSENT_S", 0.0)
    with pytest.raises(BusError, match="No router answers"):
        worker("animator", connect=free_endpoint(), run="run-test")
