"""A recorder's side of the commit: grants, and reports that are sent until they are acknowledged."""

import contextlib
import logging
from collections import deque

from readygo.common.bus import Bus
from readygo.common.errors import BusError, PeerError, RunError
from readygo.common.messages import (
    DoneRequest,
    EpisodeKey,
    ExpectRequest,
    GrantRequest,
    LostRequest,
    PendingRequest,
    TroubleRequest,
    Verdict,
    VerdictStatus,
    topics,
)

log = logging.getLogger(__name__)


class Grants:
    """What one recorder asks of the coordinator, and tells it in the order in which things happened."""

    def __init__(self, bus: Bus, recorder: str, timeout_s: float) -> None:
        self._bus = bus
        self._recorder = recorder
        self._timeout_s = timeout_s
        self._waiting: deque[DoneRequest | LostRequest] = deque()

    def expects(self, episode: EpisodeKey, attempt: int, lease: str = "") -> Verdict:
        """Are samples of this attempt due here, from the holder of this lease?

        Raises:
            BusError: If the coordinator does not answer.
        """
        request = ExpectRequest(recorder=self._recorder, episode=episode, attempt=attempt, lease=lease)
        return self._bus.request(topics.EXPECT, request, timeout_s=self._timeout_s)

    def trouble(self, reason: str) -> bool:
        """Report what keeps the recorder from recording (empty: nothing); a coordinator that is away misses it.

        Returns:
            True if other recorders record now what this one has not.
        """
        with contextlib.suppress(BusError):
            request = TroubleRequest(recorder=self._recorder, reason=reason)
            verdict = self._bus.request(topics.TROUBLE, request, timeout_s=self._timeout_s)
            return verdict.status is VerdictStatus.DONE
        return False

    def ask(self, index: int, attempt: int) -> VerdictStatus:
        """May the recorder make this attempt durable?

        Raises:
            BusError: If the coordinator does not answer; the grant may have been given.
        """
        request = GrantRequest(recorder=self._recorder, index=index, attempt=attempt)
        return self._bus.request(topics.GRANT, request, timeout_s=self._timeout_s).status

    def pending(self) -> dict[int, int]:
        """Attempts, by index, that the coordinator believes to be granted to this recorder and not yet durable.

        Raises:
            BusError: If the coordinator does not answer.
        """
        request = PendingRequest(recorder=self._recorder)
        reply = self._bus.request(topics.PENDING, request, timeout_s=self._timeout_s)
        return dict(zip(reply.indices, reply.attempts, strict=True))

    def claim_done(self, report: DoneRequest) -> bool:
        """Report an episode right now that a crash left in an open shard; False if this recorder may not keep it.

        The grant is asked for again: without one, the coordinator has given the episode to others, or has lost what it
        knew of it, and has it recorded again.

        Raises:
            BusError: If the coordinator does not answer.
        """
        return self.ask(report.index, report.attempt) is not VerdictStatus.STALE and self._report_done(report)

    def _report_done(self, report: DoneRequest) -> bool:
        verdict = self._bus.request(topics.DONE, report, timeout_s=self._timeout_s)
        return verdict.status is not VerdictStatus.STALE

    def report(self, report: DoneRequest | LostRequest) -> None:
        """Queue a report for `flush`."""
        self._waiting.append(report)

    def flush(self) -> bool:
        """Send what waits; False if the coordinator does not answer, the rest then waits on.

        Raises:
            RunError: If the coordinator refuses an episode that this recorder has made durable.
        """
        while self._waiting:
            report = self._waiting[0]
            try:
                held = self._send(report)
            except BusError as error:
                if isinstance(error, PeerError):
                    log.warning("%s", error)
                return False
            self._waiting.popleft()
            if not held:
                assert isinstance(report, DoneRequest)
                raise RunError(
                    f"Episode {report.index} is in {report.shard}, but the coordinator does not count it: it was given "
                    "to another recorder, or this one was given up. Run the same command again: one copy is kept."
                )
        return True

    def _send(self, report: DoneRequest | LostRequest) -> bool:
        if isinstance(report, DoneRequest):
            return self._report_done(report)
        self._bus.request(topics.LOST, report, timeout_s=self._timeout_s)
        return True
