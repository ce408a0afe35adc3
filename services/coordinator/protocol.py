"""The states of an episode and every way from one to another, as pure functions.

    waiting --lease--> leased --grant--> granted --commit--> committed
       ^                  |                 |                    |
       +--- advance, fail, expire, ---------+-- take back, ------+-- miss
       |    holder gone                         take over, retire
       +--- set aside --> rejected <-- reject (from leased)

`Ledger` stores what these functions return. Each takes the episode as it is and returns the changed one, or None
where the sender of the message has no right to the change: messages may be lost, repeated, late, or forged by a
process whose certificate allows to send them.
"""

import dataclasses
import enum
from collections.abc import Sequence
from dataclasses import dataclass

from readygo.common.messages import Stage, VerdictStatus

ASIDE = "set aside: "
"""Prefix of the reason of an episode that was given up, unlike those that a stage rejected."""


class StageState(enum.Enum):
    """State of an episode at its present stage."""

    WAITING = "waiting"
    """A worker may claim it."""
    LEASED = "leased"
    """A worker holds it."""
    GRANTED = "granted"
    """A recorder may write it."""
    COMMITTED = "committed"
    """A shard holds it."""
    REJECTED = "rejected"
    """It is left out for good; another index takes its place."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Holder:
    """One life of a worker process: a restarted worker has the same role and name, and another session."""

    worker: str = ""
    role: str = ""
    session: str = ""
    """Session of the worker's presence on the bus, see `Bus.announce`; empty where the worker did not announce
    itself."""


NO_HOLDER = Holder()


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeRow:
    """A row of the ledger, as far as the protocol changes it."""

    index: int
    stage: str
    state: StageState = StageState.WAITING
    attempt: int = 0
    """Number of leases so far; the present lease, grant or commit carries it."""
    failures: int = 0
    """Errors of workers, at any stage."""
    deaths: int = 0
    """Holders that ended at the present stage; zero again when it completes."""
    holder: Holder = NO_HOLDER
    recorder: str = ""
    """Recorder that the episode was last leased, granted or committed to."""
    shard: str = ""
    samples: int = 0
    driven_by: str = ""
    """Offered policy that drove the committed attempt."""
    reason: str = ""
    """Why it was rejected, or what a stage objected to that keeps rejected episodes."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Written:
    """What a recorder reports of an episode that it has written."""

    recorder: str
    attempt: int
    shard: str
    samples: int
    policy: str = ""


class Protocol:
    """The rules for the episodes of one line of stages."""

    def __init__(self, stages: Sequence[Stage]) -> None:
        """Take the line; its last stage records."""
        self._names = tuple(stage.name for stage in stages)

    @property
    def first(self) -> str:
        """Stage at which episodes begin."""
        return self._names[0]

    @property
    def last(self) -> str:
        """Stage that records."""
        return self._names[-1]

    def lease(self, episode: EpisodeRow, holder: Holder, recorder: str = "") -> EpisodeRow | None:
        """Give a waiting episode to a worker, under the next attempt number."""
        if episode.state is not StageState.WAITING:
            return None
        attempt = episode.attempt + 1
        return _replace(episode, state=StageState.LEASED, attempt=attempt, holder=holder, recorder=recorder)

    def holds(self, episode: EpisodeRow, attempt: int, stage: str = "") -> bool:
        """True if a worker holds the episode under this attempt, at this stage where one is named."""
        return episode.state is StageState.LEASED and episode.attempt == attempt and stage in ("", episode.stage)

    def advance(self, episode: EpisodeRow, stage: str, attempt: int, reason: str = "") -> EpisodeRow | None:
        """Pass an episode on to the next stage; `reason` notes what this one objects to."""
        if not self.holds(episode, attempt, stage) or stage == self.last:
            return None
        following = self._names[self._names.index(stage) + 1]
        reason = reason or episode.reason
        return _replace(_release(episode), stage=following, deaths=0, reason=reason)

    def reject(self, episode: EpisodeRow, stage: str, attempt: int, reason: str) -> EpisodeRow | None:
        """Leave an index out for good."""
        if not self.holds(episode, attempt, stage):
            return None
        return _replace(_release(episode), state=StageState.REJECTED, reason=reason)

    def fail(self, episode: EpisodeRow, stage: str, attempt: int) -> EpisodeRow | None:
        """Begin at the first stage again after a worker's error: results of earlier stages may be the cause."""
        if not self.holds(episode, attempt, stage):
            return None
        return _replace(_release(episode), stage=self.first, failures=episode.failures + 1)

    def expire(self, episode: EpisodeRow) -> EpisodeRow | None:
        """End a lease whose time is over."""
        return _release(episode) if episode.state is StageState.LEASED else None

    def lose_holder(self, episode: EpisodeRow, holder: Holder) -> EpisodeRow | None:
        """End a lease because exactly this life of its worker ended."""
        if episode.state is not StageState.LEASED or episode.holder != holder or not holder.session:
            return None
        return _replace(_release(episode), deaths=episode.deaths + 1)

    def restart(self, episode: EpisodeRow) -> EpisodeRow | None:
        """Begin at the first stage again: a result of an earlier stage is lost."""
        if episode.state not in (StageState.WAITING, StageState.LEASED):
            return None
        return _replace(_release(episode), stage=self.first)

    def set_aside(self, episode: EpisodeRow, reason: str) -> EpisodeRow | None:
        """Give up an episode that fails again and again."""
        return (
            _replace(episode, state=StageState.REJECTED, reason=ASIDE + reason)
            if episode.state is StageState.WAITING
            else None
        )

    def append_verdict(self, episode: EpisodeRow, attempt: int) -> VerdictStatus:
        """OK if samples of this attempt may come to its recorder, DONE if the episode is durable."""
        if episode.state is StageState.COMMITTED:
            return VerdictStatus.DONE
        held = episode.state in (StageState.LEASED, StageState.GRANTED) and episode.stage == self.last
        return VerdictStatus.OK if held and episode.attempt == attempt else VerdictStatus.STALE

    def grant(self, episode: EpisodeRow, recorder: str, attempt: int) -> tuple[EpisodeRow | None, VerdictStatus]:
        """Let the recorder that an attempt was leased to make it durable; asking again changes nothing.

        Returns:
            The changed episode, None where nothing changes; OK, STALE, or DONE for an episode that is durable.
        """
        verdict = self.append_verdict(episode, attempt)
        if verdict is not VerdictStatus.OK:
            return None, verdict
        if episode.recorder != recorder:
            return None, VerdictStatus.STALE
        granted = episode.state is StageState.GRANTED
        return (None if granted else _replace(_release(episode), state=StageState.GRANTED)), VerdictStatus.OK

    def commit(self, episode: EpisodeRow, written: Written) -> EpisodeRow | None:
        """Note an episode as durable that was granted to this recorder under this attempt.

        The recorder that has committed it may report it again: the shard has another name once it was saved from a
        crash.
        """
        if episode.recorder != written.recorder or written.samples < 1:
            return None
        if episode.state is StageState.GRANTED and episode.attempt == written.attempt:
            return _commit(episode, written)
        if episode.state is StageState.COMMITTED and episode.samples == written.samples:
            return _replace(episode, shard=written.shard)
        return None

    def completes(self, episode: EpisodeRow, stage: str, attempt: int) -> bool:
        """True if a worker may report on this attempt: it holds the episode, or held it until a recorder took over."""
        taken_over = episode.state in (StageState.GRANTED, StageState.COMMITTED) and stage == episode.stage == self.last
        return self.holds(episode, attempt, stage) or (taken_over and episode.attempt == attempt)

    def take_back(self, episode: EpisodeRow, recorder: str, attempt: int) -> EpisodeRow | None:
        """Undo a grant whose episode did not become durable."""
        if (episode.state, episode.recorder, episode.attempt) != (StageState.GRANTED, recorder, attempt):
            return None
        return _release(episode)

    def take_from(self, episode: EpisodeRow, recorder: str) -> EpisodeRow | None:
        """Have another recorder take an episode that is on its way to this one and not durable."""
        under_way = episode.state in (StageState.LEASED, StageState.GRANTED) and episode.stage == self.last
        return _release(episode) if under_way and episode.recorder == recorder else None

    def retire(self, episode: EpisodeRow, recorder: str) -> EpisodeRow | None:
        """Make again what a recorder has, or was to get, that is given up."""
        if episode.recorder != recorder or episode.state not in (
            StageState.LEASED,
            StageState.GRANTED,
            StageState.COMMITTED,
        ):
            return None
        return self.forget(episode)

    def forget(self, episode: EpisodeRow) -> EpisodeRow:
        """Begin at the first stage again, durable or not: its shard is lost."""
        return _replace(_release(episode), stage=self.first, shard="", samples=0, driven_by="")

    def doubt(self, episode: EpisodeRow) -> EpisodeRow | None:
        """Have the recorder of a durable episode say again whether it has it."""
        return _replace(episode, state=StageState.GRANTED) if episode.state is StageState.COMMITTED else None

    def entrust(self, episode: EpisodeRow, recorder: str) -> EpisodeRow | None:
        """Have a recorder say whether an episode is durable that an open shard of it seems to hold.

        For a process that can look into the shard, not for messages.
        """
        if episode.state in (StageState.GRANTED, StageState.COMMITTED, StageState.REJECTED):
            return None
        return _replace(_release(episode), state=StageState.GRANTED, stage=self.last, recorder=recorder)

    def adopt(self, episode: EpisodeRow, written: Written) -> EpisodeRow | None:
        """Note an episode as durable that a finished shard holds.

        For a process that can look into the shard, not for messages.
        """
        if episode.state is StageState.COMMITTED and episode.recorder != written.recorder:
            return None
        return _commit(_replace(episode, recorder=written.recorder, stage=self.last), written)


def _commit(episode: EpisodeRow, written: Written) -> EpisodeRow:
    return _replace(
        _release(episode),
        state=StageState.COMMITTED,
        shard=written.shard,
        samples=written.samples,
        driven_by=written.policy,
    )


def _release(episode: EpisodeRow) -> EpisodeRow:
    return _replace(episode, state=StageState.WAITING, holder=NO_HOLDER)


_replace = dataclasses.replace
