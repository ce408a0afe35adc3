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


class State(enum.Enum):
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
class Episode:
    """A row of the ledger, as far as the protocol changes it."""

    index: int
    stage: str
    state: State = State.WAITING
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

    def lease(self, episode: Episode, holder: Holder, recorder: str = "") -> Episode | None:
        """Give a waiting episode to a worker, under the next attempt number."""
        if episode.state is not State.WAITING:
            return None
        attempt = episode.attempt + 1
        return _replace(episode, state=State.LEASED, attempt=attempt, holder=holder, recorder=recorder)

    def holds(self, episode: Episode, attempt: int, stage: str = "") -> bool:
        """True if a worker holds the episode under this attempt, at this stage where one is named."""
        return episode.state is State.LEASED and episode.attempt == attempt and stage in ("", episode.stage)

    def advance(self, episode: Episode, stage: str, attempt: int, reason: str = "") -> Episode | None:
        """Pass an episode on to the next stage; `reason` notes what this one objects to."""
        if not self.holds(episode, attempt, stage) or stage == self.last:
            return None
        following = self._names[self._names.index(stage) + 1]
        reason = reason or episode.reason
        return _replace(_released(episode), stage=following, deaths=0, reason=reason)

    def reject(self, episode: Episode, stage: str, attempt: int, reason: str) -> Episode | None:
        """Leave an index out for good."""
        if not self.holds(episode, attempt, stage):
            return None
        return _replace(_released(episode), state=State.REJECTED, reason=reason)

    def fail(self, episode: Episode, stage: str, attempt: int) -> Episode | None:
        """Begin at the first stage again after a worker's error: results of earlier stages may be the cause."""
        if not self.holds(episode, attempt, stage):
            return None
        return _replace(_released(episode), stage=self.first, failures=episode.failures + 1)

    def expire(self, episode: Episode) -> Episode | None:
        """End a lease whose time is over."""
        return _released(episode) if episode.state is State.LEASED else None

    def lose_holder(self, episode: Episode, holder: Holder) -> Episode | None:
        """End a lease because exactly this life of its worker ended."""
        if episode.state is not State.LEASED or episode.holder != holder or not holder.session:
            return None
        return _replace(_released(episode), deaths=episode.deaths + 1)

    def restart(self, episode: Episode) -> Episode | None:
        """Begin at the first stage again: a result of an earlier stage is lost."""
        if episode.state not in (State.WAITING, State.LEASED):
            return None
        return _replace(_released(episode), stage=self.first)

    def set_aside(self, episode: Episode, reason: str) -> Episode | None:
        """Give up an episode that fails again and again."""
        return (
            _replace(episode, state=State.REJECTED, reason=ASIDE + reason) if episode.state is State.WAITING else None
        )

    def expected(self, episode: Episode, attempt: int) -> VerdictStatus:
        """OK if samples of this attempt may come to its recorder, DONE if the episode is durable."""
        if episode.state is State.COMMITTED:
            return VerdictStatus.DONE
        held = episode.state in (State.LEASED, State.GRANTED) and episode.stage == self.last
        return VerdictStatus.OK if held and episode.attempt == attempt else VerdictStatus.STALE

    def grant(self, episode: Episode, recorder: str, attempt: int) -> tuple[Episode | None, VerdictStatus]:
        """Let the recorder that an attempt was leased to make it durable; asking again changes nothing.

        Returns:
            The changed episode, None where nothing changes; OK, STALE, or DONE for an episode that is durable.
        """
        verdict = self.expected(episode, attempt)
        if verdict is not VerdictStatus.OK:
            return None, verdict
        if episode.recorder != recorder:
            return None, VerdictStatus.STALE
        granted = episode.state is State.GRANTED
        return (None if granted else _replace(_released(episode), state=State.GRANTED)), VerdictStatus.OK

    def commit(self, episode: Episode, written: Written) -> Episode | None:
        """Note an episode as durable that was granted to this recorder under this attempt.

        The recorder that has committed it may report it again: the shard has another name once it was saved from a
        crash.
        """
        if episode.recorder != written.recorder or written.samples < 1:
            return None
        if episode.state is State.GRANTED and episode.attempt == written.attempt:
            return _committed(episode, written)
        if episode.state is State.COMMITTED and episode.samples == written.samples:
            return _replace(episode, shard=written.shard)
        return None

    def completes(self, episode: Episode, stage: str, attempt: int) -> bool:
        """True if a worker may report on this attempt: it holds the episode, or held it until a recorder took over."""
        taken_over = episode.state in (State.GRANTED, State.COMMITTED) and stage == episode.stage == self.last
        return self.holds(episode, attempt, stage) or (taken_over and episode.attempt == attempt)

    def take_back(self, episode: Episode, recorder: str, attempt: int) -> Episode | None:
        """Undo a grant whose episode did not become durable."""
        if (episode.state, episode.recorder, episode.attempt) != (State.GRANTED, recorder, attempt):
            return None
        return _released(episode)

    def take_from(self, episode: Episode, recorder: str) -> Episode | None:
        """Have another recorder take an episode that is on its way to this one and not durable."""
        under_way = episode.state in (State.LEASED, State.GRANTED) and episode.stage == self.last
        return _released(episode) if under_way and episode.recorder == recorder else None

    def retire(self, episode: Episode, recorder: str) -> Episode | None:
        """Make again what a recorder has, or was to get, that is given up."""
        if episode.recorder != recorder or episode.state not in (State.LEASED, State.GRANTED, State.COMMITTED):
            return None
        return self.forget(episode)

    def forget(self, episode: Episode) -> Episode:
        """Begin at the first stage again, durable or not: its shard is lost."""
        return _replace(_released(episode), stage=self.first, shard="", samples=0, driven_by="")

    def doubt(self, episode: Episode) -> Episode | None:
        """Have the recorder of a durable episode say again whether it has it."""
        return _replace(episode, state=State.GRANTED) if episode.state is State.COMMITTED else None

    def entrust(self, episode: Episode, recorder: str) -> Episode | None:
        """Have a recorder say whether an episode is durable that an open shard of it seems to hold.

        For a process that can look into the shard, not for messages.
        """
        if episode.state in (State.GRANTED, State.COMMITTED, State.REJECTED):
            return None
        return _replace(_released(episode), state=State.GRANTED, stage=self.last, recorder=recorder)

    def adopt(self, episode: Episode, written: Written) -> Episode | None:
        """Note an episode as durable that a finished shard holds.

        For a process that can look into the shard, not for messages.
        """
        if episode.state is State.COMMITTED and episode.recorder != written.recorder:
            return None
        return _committed(_replace(episode, recorder=written.recorder, stage=self.last), written)


def _committed(episode: Episode, written: Written) -> Episode:
    return _replace(
        _released(episode),
        state=State.COMMITTED,
        shard=written.shard,
        samples=written.samples,
        driven_by=written.policy,
    )


def _released(episode: Episode) -> Episode:
    return _replace(episode, state=State.WAITING, holder=NO_HOLDER)


_replace = dataclasses.replace
