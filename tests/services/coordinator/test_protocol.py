"""The rules one by one are in test_ledger.py and handlers/; here they are explored as a whole."""

import dataclasses

import pytest

from readygo.services.coordinator.protocol import EpisodeRow, Holder, Protocol, StageState, Written
from tests.services.coordinator.recording_model import FILM, PLAN, Bounds, Found, explore

LINE = (PLAN, FILM)


class EndsLeasesByName(Protocol):
    """A token of any role and session ends the leases of its name."""

    def lose_holder(self, episode: EpisodeRow, holder: Holder) -> EpisodeRow | None:
        return super().lose_holder(episode, episode.holder)


class BelievesAnyDone(Protocol):
    """Any recorder may report any episode as durable, unless another one has."""

    def commit(self, episode: EpisodeRow, written: Written) -> EpisodeRow | None:
        if episode.state is StageState.COMMITTED:
            return super().commit(episode, written)
        return self.adopt(episode, written)


class BelievesLateDone(Protocol):
    """The granted recorder may report an earlier attempt."""

    def commit(self, episode: EpisodeRow, written: Written) -> EpisodeRow | None:
        return super().commit(episode, dataclasses.replace(written, attempt=episode.attempt))


class TakesBackAnyAttempt(Protocol):
    """A repeated report of an earlier attempt takes back the present grant."""

    def take_back(self, episode: EpisodeRow, recorder: str, attempt: int) -> EpisodeRow | None:
        return super().take_back(episode, recorder, episode.attempt)


def _explored(protocol: type[Protocol], **bounds: int) -> Found:
    return explore(protocol(LINE), Bounds(**bounds))


@pytest.mark.parametrize(
    ("bounds", "states"),
    [
        ({"wanted": 1, "attempts": 3, "crashes": 1, "deaths": 1}, 10_103),
        ({"wanted": 2, "attempts": 2, "crashes": 1, "deaths": 1}, 18_606),
    ],
)
def test_committed_are_the_smallest_accepted_indices_whatever_arrives(bounds: dict[str, int], states: int) -> None:
    found = _explored(Protocol, **bounds)
    assert found.violations == ()
    assert found.stuck == 0, "the run can always be finished"
    assert found.finished > 0
    assert found.states == states


@pytest.mark.slow
def test_three_attempts_at_recording_end_in_the_same_episodes() -> None:
    found = _explored(Protocol, wanted=1, attempts=4, crashes=0, deaths=0)
    assert (found.violations, found.stuck, found.states) == ((), 0, 88_621)


@pytest.mark.parametrize(
    ("protocol", "words"),
    [
        (EndsLeasesByName, "is given up: set aside: workers ended"),
        (BelievesAnyDone, "committed and not in a shard"),
        (BelievesLateDone, "committed and not in a shard"),
        pytest.param(TakesBackAnyAttempt, "is in 2 shards", marks=pytest.mark.slow),
    ],
)
def test_hole_in_the_protocol_is_found(protocol: type[Protocol], words: str) -> None:
    attempts = 4 if protocol is TakesBackAnyAttempt else 3
    found = _explored(protocol, wanted=1, attempts=attempts, crashes=1, deaths=1)
    assert any(words in violation for violation in found.violations)
