import pytest

from readygo.common.errors import BusError, RunError
from readygo.common.fleet.grants import Grants
from readygo.common.messages import DoneRequest, LostRequest, VerdictStatus
from tests.services.recorder.coordinator import FakeCoordinator


def _done(index: int) -> DoneRequest:
    return DoneRequest(recorder="r0", index=index, attempt=1, shard="shard", sample_count=4)


@pytest.fixture
def coordinator() -> FakeCoordinator:
    return FakeCoordinator()


@pytest.fixture
def grants(coordinator: FakeCoordinator) -> Grants:
    return Grants(coordinator.bus, "r0", timeout_s=0.1)


def test_grant_is_pending_until_it_is_reported(coordinator: FakeCoordinator, grants: Grants) -> None:
    assert grants.ask(4, 2) is VerdictStatus.OK
    assert coordinator.granted == {4: 2}
    assert grants.pending() == {4: 2}
    assert grants.claim_done(_done(4))
    assert grants.pending() == {}


def test_refused_grant_says_why(coordinator: FakeCoordinator, grants: Grants) -> None:
    coordinator.verdicts = {1: VerdictStatus.STALE, 2: VerdictStatus.DONE}
    assert [grants.ask(index, 1) for index in (1, 2)] == [VerdictStatus.STALE, VerdictStatus.DONE]


def test_absent_coordinator_is_an_error_of_the_bus(coordinator: FakeCoordinator, grants: Grants) -> None:
    coordinator.go_away()
    with pytest.raises(BusError):
        grants.ask(0, 1)
    with pytest.raises(BusError):
        grants.pending()


def test_reports_wait_in_their_order_until_they_are_acknowledged(coordinator: FakeCoordinator, grants: Grants) -> None:
    coordinator.away = {"lost"}
    lost = LostRequest(recorder="r0", index=1, reason="")
    for report in (_done(0), lost, _done(2)):
        grants.report(report)
    assert not grants.flush()
    assert coordinator.done_indices == [0]
    coordinator.away = set()
    assert grants.flush()
    assert (coordinator.done_indices, coordinator.lost) == ([0, 2], [lost])
    assert grants.flush()
    assert coordinator.done_indices == [0, 2]


def test_episode_that_is_in_another_recorders_shard_is_an_error_once(
    coordinator: FakeCoordinator, grants: Grants
) -> None:
    coordinator.stale_done = {0}
    assert not grants.claim_done(_done(0))
    grants.report(_done(0))
    with pytest.raises(RunError, match="Episode 0 is in shard, but the coordinator does not count it"):
        grants.flush()
    assert grants.flush()
