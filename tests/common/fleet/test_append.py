from collections.abc import Iterator

import pytest

from readygo.common.bus import InProcessBus
from readygo.common.errors import BusError, DatasetError, RunError
from readygo.common.fleet import append, append_episode
from readygo.common.messages import AppendReply, AppendRequest, AppendStatus, ClaimReply, ClaimStatus, topics
from tests.common.dataset.episodes import make_episode

CLAIM = ClaimReply(status=ClaimStatus.LEASE, attempt=3, recorder="rec1")
OK = AppendReply(status=AppendStatus.OK)
COMMITTED = AppendReply(status=AppendStatus.COMMITTED)
RETRY = AppendReply(status=AppendStatus.RETRY, detail="the coordinator does not answer")


@pytest.fixture(autouse=True)
def _time_flies(monkeypatch: pytest.MonkeyPatch) -> None:
    now_s = [0.0]
    monkeypatch.setattr(append.time, "monotonic", lambda: now_s[0])
    monkeypatch.setattr(append.time, "sleep", lambda seconds: now_s.__setitem__(0, now_s[0] + seconds))


def send(replies: Iterator[AppendReply | Exception], count: int = 20) -> list[tuple[int, int, bool]]:
    """Send an episode; returns first sample, number of samples and `last` of every batch that was sent."""
    bus = InProcessBus()
    batches = []

    def take(request: AppendRequest) -> AppendReply:
        assert request.attempt == 3
        assert [sample.seq for sample in request.samples] == [
            request.first_seq + number for number in range(len(request.samples))
        ]
        batches.append((request.first_seq, len(request.samples), request.last))
        reply = next(replies)
        if isinstance(reply, Exception):
            raise reply
        return reply

    bus.serve(topics.append("rec1"), take)
    header, samples = make_episode(0, count)
    append_episode(bus, CLAIM, header, iter(samples))
    return batches


def test_episode_goes_in_batches_of_eight_until_it_is_durable() -> None:
    assert send(iter([OK, OK, COMMITTED])) == [(0, 8, False), (8, 8, False), (16, 4, True)]
    assert send(iter([OK, COMMITTED]), 16) == [(0, 8, False), (8, 8, True)]


def test_gap_is_sent_again_from_where_the_recorder_says() -> None:
    gap = AppendReply(status=AppendStatus.GAP, expected_seq=5)
    assert send(iter([OK, gap, OK, COMMITTED])) == [(0, 8, False), (8, 8, False), (5, 8, False), (13, 7, True)]


@pytest.mark.parametrize("status", [AppendStatus.STALE, AppendStatus.DUP])
def test_episode_that_is_somebody_elses_or_durable_is_dropped(status: AppendStatus) -> None:
    assert send(iter([OK, AppendReply(status=status)])) == [(0, 8, False), (8, 8, False)]


def test_batch_is_sent_again_while_the_coordinator_is_away() -> None:
    assert send(iter([RETRY, RETRY, COMMITTED]), 1) == [(0, 1, True)] * 3


def test_recorder_that_answers_is_waited_for_however_long_its_disk_is_full() -> None:
    assert len(send(iter([RETRY] * 500 + [COMMITTED]), 1)) == 501


def test_recorder_that_is_not_there_is_no_fault_of_the_episode() -> None:
    header, samples = make_episode(0, 1)
    with pytest.raises(BusError, match="No participant answered rec/rec1/append"):
        append_episode(InProcessBus(), CLAIM, header, iter(samples))


def test_refusal_is_not_tried_again() -> None:
    refusals: Iterator[Exception] = iter([DatasetError("two different headers"), RuntimeError("asked twice")])
    with pytest.raises(RunError, match="Recorder rec1 refused the samples: rec/rec1/append: two different headers"):
        send(refusals)
