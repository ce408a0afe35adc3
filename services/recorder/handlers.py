"""Samples in, durable episodes out: exactly once, even when processes die."""

import logging
import re
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

from readygo.common.bus import Bus
from readygo.common.dataset import EpisodeChunk, Provenance, encode_episode
from readygo.common.dataset.encode import outputs_of
from readygo.common.dataset.provenance import provenance_to_strings
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import BusError, DiskError, RunError
from readygo.common.fleet.grants import Grants
from readygo.common.messages import (
    AppendReply,
    AppendRequest,
    AppendStatus,
    CommittedEpisode,
    DoneRequest,
    EpisodeKey,
    LostRequest,
    Split,
    VerdictStatus,
    topics,
)
from readygo.common.messages.live import LiveCommit
from readygo.services.recorder.buffers import EpisodeBuffer, EpisodeBuffers
from readygo.services.recorder.config import RecorderConfig
from readygo.services.recorder.disk import disk_error, try_room
from readygo.services.recorder.name_lock import NameLock
from readygo.services.recorder.salvage import Durable
from readygo.services.recorder.shards import Shards

_log = logging.getLogger(__name__)

COORDINATOR_TIMEOUT_S = 3.0
"""Longest wait for a reply of the coordinator [s]."""
RECONCILE_S = 10.0
"""How often the recorder asks which grants it holds: a grant whose answer came too late is answered for [s]."""
FULL_S = 1.0
"""A disk that took nothing is tried again after this time [s]."""


@dataclass(frozen=True, kw_only=True)
class RecorderState:
    """State of a recorder."""

    episodes: int
    """Number of durable episodes in its shards."""
    buffered_episodes: int
    """Number of episodes that are coming in."""
    buffered_bytes: int
    """Bytes of their images so far."""
    trouble: str
    """Why the disk takes nothing; empty while it does."""


class Recorder:
    """Owns the shards of one name in one folder; safe to call from several threads."""

    def __init__(
        self,
        folder: Path,
        name: str,
        bus: Bus,
        provenance: Provenance,
        config: RecorderConfig | None = None,
        stage: Scenery | None = None,
    ) -> None:
        """Take over the folder: finished shards are read, open ones are saved as soon as the coordinator answers.

        Args:
            folder: Where the shards go; made if it is missing.
            name: The recorder's name, part of its topic and of its shards' names.
            bus: Where the coordinator is asked.
            provenance: What every shard says about its run.
            config: Settings.
            stage: What viewers show around the samples.

        Raises:
            RunError: If another process records under this name into this folder, or the folder cannot be written.
            DatasetError: If a finished shard is damaged, or the provenance is no plain data.
        """
        provenance_to_strings(provenance)
        if not re.fullmatch(r"[A-Za-z0-9_]+", name):
            raise RunError(f"A recorder's name must be letters, digits and underscores, got {name!r}.")
        self.name = name
        self._folder = Path(folder)
        self._bus = bus
        config = config or RecorderConfig()
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            self._name_lock = NameLock(self._folder, name)
        except OSError as error:
            raise disk_error(self._folder, error) from error
        self._buffers = EpisodeBuffers(config.buffer_mib * 2**20)
        self._grants = Grants(bus, name, COORDINATOR_TIMEOUT_S)
        self._run: tuple[int, Split] | None = None
        self._reconciled, self._reconciled_s = False, 0.0
        """Whether every grant was answered for, and when that was looked at last."""
        self._trouble = ""
        """Why the disk takes nothing."""
        self._tried_s = 0.0
        """When the disk was tried last [s]."""
        self._closed = False
        self._lock = threading.RLock()
        try:
            self._shards = Shards(self._folder, name, provenance, config, stage or Scenery())
        except BaseException:
            self._name_lock.release()
            raise

    def append(self, request: AppendRequest) -> AppendReply:
        """Take a batch of samples; the last one of an episode makes it durable.

        A disk that is full or read-only is waited for: the sender is asked to try again.

        Raises:
            DatasetError: If the sender contradicts itself.
            RunError: If the disk refuses otherwise, or the episode belongs to another run.
        """
        with self._lock:
            episode = request.header.episode
            if self._closed:
                return AppendReply(status=AppendStatus.RETRY, detail=f"recorder {self.name} is closed")
            if episode.index in self._shards.durable:
                self._check_run(episode)
                return self._tell_again(self._shards.durable[episode.index], request.attempt)
            if (unexpected := self._refuse_unexpected(request)) is not None:
                return unexpected
            self._check_run(episode)
            reply = self._buffers.add(request)
            return self._commit(episode.index) if reply.status is AppendStatus.OK and request.last else reply

    @property
    def folder(self) -> Path:
        """Folder of its shards."""
        return self._folder

    def state(self) -> RecorderState:
        """How it is now; never waits for a disk."""
        return RecorderState(
            episodes=len(self._shards.durable),
            buffered_episodes=self._buffers.count,
            buffered_bytes=self._buffers.size_bytes,
            trouble=self._trouble,
        )

    def _tell_again(self, durable: Durable, attempt: int) -> AppendReply:
        """Answer for an attempt at a durable episode: the coordinator may have lost what it knew of it.

        Then the attempt is granted, and the episode that is there is reported under it: its samples are the same.
        """
        try:
            verdict = self._grants.ask(durable.episode.index, attempt)
        except BusError as error:
            self._reconciled = False
            return AppendReply(status=AppendStatus.RETRY, detail=str(error))
        if verdict is VerdictStatus.OK:
            self._grants.report(self._done_report(durable, attempt))
            self._grants.flush()
        return self._finish(durable.episode.index, AppendStatus.DUP)

    def _refuse_unexpected(self, request: AppendRequest) -> AppendReply | None:
        """The answer to an attempt that is new here unless the coordinator has leased it; None if samples may come."""
        episode = request.header.episode
        buffer = self._buffers.get(episode.index)
        if buffer is not None and (request.attempt < buffer.attempt or request.lease == buffer.lease):
            return None
        try:
            verdict = self._grants.expects(episode, request.attempt, request.lease)
        except BusError as error:
            return AppendReply(status=AppendStatus.RETRY, detail=str(error))
        if verdict.status is VerdictStatus.OK:
            return None
        status = AppendStatus.DUP if verdict.status is VerdictStatus.DONE else AppendStatus.STALE
        return AppendReply(status=status, detail=verdict.reason)

    def settle(self) -> bool:
        """Send outstanding reports and, once after a start, clear up what the last process left.

        Call it now and then: the coordinator may have been away when the run's last episode became durable, and a
        disk that took nothing may take it now.

        Returns:
            True if nothing is outstanding; False if the coordinator does not answer or the disk takes nothing.

        Raises:
            RunError: If the disk refuses.
        """
        with self._lock:
            if not self._grants.flush():
                return False
            if time.monotonic() - self._reconciled_s > RECONCILE_S:
                self._reconciled = False
            if not self._reconciled and not self._cleared_up():
                return False
            return self._grants.flush()

    def _cleared_up(self) -> bool:
        """Clear up what the last process, or a disk that took nothing, has left; False if that must be tried again."""
        if self._trouble and time.monotonic() - self._tried_s < FULL_S:
            return False
        try:
            if self._trouble:
                try_room(self._folder, self.name)
            self._reconcile()
        except BusError:
            return False
        except DiskError as error:
            self._disk_refuses(error)
        if self._reconciled and self._trouble:
            self._trouble = ""
            _log.warning("%s can be written again", self._folder)
            self._grants.trouble("")
        return self._reconciled

    def close(self) -> None:
        """Finish the open shard; unfinished episodes are forgotten, their leases run out.

        Raises:
            RunError: If the disk refuses; the episodes are safe in the open shard, and the next start finishes it.
        """
        with self._lock:
            if not self._closed:
                self._closed = True
                self.settle()
            self._shards.close()
            self._name_lock.release()

    def leave(self) -> None:
        """Leave the name to others, and an open shard to the next process of it; after `close` nothing happens."""
        with self._lock:
            self._closed = True
            self._shards.leave_open()
            self._name_lock.release()

    def _commit(self, index: int) -> AppendReply:
        """Make a complete episode durable."""
        if not self.settle():
            return AppendReply(status=AppendStatus.RETRY, detail=self._trouble or "the coordinator does not answer")
        return self._record(index)

    def _record(self, index: int) -> AppendReply:
        """Ask for the grant of a complete episode, and write it."""
        buffer = self._buffers.get(index)
        if index in self._shards.durable or buffer is None:
            return self._finish(index, AppendStatus.DUP)
        place = self._shards.place(outputs_of(buffer.header, buffer.samples[0]))
        chunk = encode_episode(buffer.header, buffer.attempt, buffer.samples, place)
        try:
            verdict = self._grants.ask(index, buffer.attempt)
        except BusError as error:
            # The grant may have been given and its answer lost: ask again what is pending.
            self._reconciled = False
            return AppendReply(status=AppendStatus.RETRY, detail=str(error))
        if verdict is not VerdictStatus.OK:
            return self._finish(index, AppendStatus.DUP if verdict is VerdictStatus.DONE else AppendStatus.STALE)
        try:
            self._write(chunk)
        except DiskError as error:
            self._disk_refuses(error)
            return AppendReply(status=AppendStatus.RETRY, detail=str(error))
        self._publish(buffer)
        return self._finish(index, AppendStatus.COMMITTED)

    def _disk_refuses(self, error: DiskError) -> None:
        """Wait for the disk: grants are kept, and their episodes written when it takes them."""
        if not self._trouble:
            _log.warning("%s", error)
        # Others take over what is granted and not reported: what is durable is reported first.
        if self._grants.flush() and self._grants.trouble(str(error)):
            self._buffers.clear()
        self._trouble, self._tried_s = str(error), time.monotonic()
        self._reconciled = False
        self._shards.leave_broken()

    def _publish(self, buffer: EpisodeBuffer) -> None:
        """Publish a durable episode for learners; a learner that misses it finds it in the shard."""
        message = CommittedEpisode(header=buffer.header, attempt=buffer.attempt, samples=tuple(buffer.samples))
        try:
            self._bus.publish(topics.COMMITTED, message)
            self._bus.tell(topics.COMMIT, lambda: self._live_commit(buffer))
        except Exception:
            # Recording must not depend on who listens.
            _log.exception("%s was not published", buffer.header.episode.episode_id)

    def _live_commit(self, buffer: EpisodeBuffer) -> LiveCommit:
        header = buffer.header
        return LiveCommit(
            episode=header.episode,
            attempt=buffer.attempt,
            outcome=header.outcome,
            driver=header.driver,
            policy=header.policy,
            sample_count=header.sample_count,
            shard=self._shards.durable[header.episode.index].shard,
        )

    def _finish(self, index: int, status: AppendStatus) -> AppendReply:
        self._buffers.drop(index)
        return AppendReply(status=status)

    def _write(self, chunk: EpisodeChunk) -> None:
        """Write a granted episode and report it, done or lost."""
        try:
            durable = self._shards.write(chunk)
        except DiskError:
            raise
        except RunError as failure:
            self._buffers.drop(chunk.episode.index)
            self._grants.report(self._lost_report(chunk.episode.index, chunk.attempt, str(failure)))
            self._grants.flush()
            raise
        self._grants.report(self._done_report(durable, durable.attempt))
        self._grants.flush()
        self._shards.finish_full()

    def _lost_report(self, index: int, attempt: int, reason: str = "") -> LostRequest:
        return LostRequest(recorder=self.name, index=index, attempt=attempt, reason=reason)

    def _salvage_report(self, durable: Durable, pending: Mapping[int, int]) -> DoneRequest:
        """An episode that a crash left, under the attempt that is granted now: its samples are the same."""
        return self._done_report(durable, pending.get(durable.episode.index, durable.attempt))

    def _done_report(self, durable: Durable, attempt: int) -> DoneRequest:
        return DoneRequest(
            recorder=self.name,
            index=durable.episode.index,
            attempt=attempt,
            shard=durable.shard,
            sample_count=durable.sample_count,
            policy=durable.policy,
        )

    def _reconcile(self) -> None:
        """Save open shards, and answer for every grant that the coordinator believes this recorder holds."""
        pending = self._grants.pending()
        self._shards.salvage(lambda durable: self._grants.claim_done(self._salvage_report(durable, pending)))
        pending = self._grants.pending()
        self._reconciled, self._reconciled_s = True, time.monotonic()
        for index, attempt in pending.items():
            buffer = self._buffers.get(index)
            if index in self._shards.durable:
                self._grants.report(self._done_report(self._shards.durable[index], attempt))
            elif buffer is not None and buffer.complete and buffer.attempt == attempt:
                self._record(index)
            else:
                self._grants.report(self._lost_report(index, attempt))

    def _check_run(self, episode: EpisodeKey) -> None:
        """Indices name episodes within one run only."""
        if self._run is None:
            first = next(iter(self._shards.durable.values()), None)
            self._run = (first.episode.seed, first.episode.split) if first else (episode.seed, episode.split)
        if (episode.seed, episode.split) != self._run:
            raise RunError(
                f"Folder {self._folder} holds {self._run[1].value} episodes of seed {self._run[0]}, got "
                f"{episode.episode_id}; record every run into a separate folder."
            )


def handle_append(recorder: Recorder, request: AppendRequest) -> AppendReply:
    """Take a batch of samples."""
    return recorder.append(request)
