import dataclasses

import pytest

from readygo.apps.observe import episodes
from readygo.apps.observe.episodes import EpisodeClock
from readygo.common.messages import (
    ClaimReply,
    ClaimStatus,
    DoneRequest,
    EpisodeKey,
    Split,
    Verdict,
    VerdictStatus,
)

KEY = EpisodeKey(seed=0, split=Split.TRAIN, index=4)


def test_episode_takes_from_its_first_lease_until_it_is_durable_once() -> None:
    times = iter([10.0, 20.0, 35.0])
    done: list[float] = []
    clock = EpisodeClock(done.append, lambda: next(times))
    for attempt in (1, 2):
        clock.observe_reply(None, ClaimReply(status=ClaimStatus.LEASE, episode=KEY, attempt=attempt))
    report = DoneRequest(recorder="rec0", index=4, attempt=2, shard="s", sample_count=40)
    for _ in range(2):
        clock.observe_reply(report, Verdict(status=VerdictStatus.OK))
    assert done == [25.0]


def test_episodes_that_were_begun_elsewhere_or_are_not_durable_are_not_told(monkeypatch: pytest.MonkeyPatch) -> None:
    times = iter([4.0, 5.0, 6.0, 10.0, 10.0])
    done: list[float] = []
    clock = EpisodeClock(done.append, lambda: next(times))
    monkeypatch.setattr(episodes, "EPISODES_MAX", 2)
    report = DoneRequest(recorder="rec0", index=4, attempt=1, shard="s", sample_count=40)
    ok = Verdict(status=VerdictStatus.OK)
    clock.observe_reply(report, ok)
    for index in (4, 5, 6):
        episode = dataclasses.replace(KEY, index=index)
        clock.observe_reply(None, ClaimReply(status=ClaimStatus.LEASE, episode=episode, attempt=1))
    clock.observe_reply(None, ClaimReply(status=ClaimStatus.WAIT))
    clock.observe_reply(dataclasses.replace(report, index=5), Verdict(status=VerdictStatus.STALE))
    clock.observe_reply(dataclasses.replace(report, index=5), None)
    assert done == []
    for index in (4, 5, 6):
        clock.observe_reply(dataclasses.replace(report, index=index), ok)
    assert done == [5.0, 4.0], "the oldest is forgotten"
