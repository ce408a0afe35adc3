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
    times, done = iter([10, 20, 30]), []
    clock = EpisodeClock(lambda *known: done.append(known), lambda: next(times))
    for attempt in (1, 2):
        clock.answered("claim", None, ClaimReply(status=ClaimStatus.LEASE, episode=KEY, attempt=attempt))
    report = DoneRequest(recorder="rec0", index=4, attempt=2, shard="s", sample_count=40)
    for _ in range(2):
        clock.answered("done", report, Verdict(status=VerdictStatus.OK))
    assert done == [(KEY.episode_id, 10, 30, 2, 40)]
