"""A coordinator that can be away, refuse, and remember what it was told."""

from readygo.common.bus import Bus, InProcessBus
from readygo.common.errors import BusError
from readygo.common.messages import (
    DoneRequest,
    ExpectRequest,
    GrantRequest,
    LostRequest,
    PendingReply,
    PendingRequest,
    TroubleRequest,
    Verdict,
    VerdictStatus,
    topics,
)


class FakeCoordinator:
    def __init__(self, bus: Bus | None = None) -> None:
        self.bus: Bus = bus or InProcessBus()
        self.away: set[str] = set()
        """Topics that are not answered; "grant-reply" acts on the grant and loses the answer."""
        self.verdicts: dict[int, VerdictStatus] = {}
        self.stale_done: set[int] = set()
        self.granted: dict[int, int] = {}
        self.done: list[DoneRequest] = []
        self.lost: list[LostRequest] = []
        self.unexpected: dict[int, VerdictStatus] = {}
        """What is said to samples of an episode; OK if nothing is."""
        self.troubles: list[str] = []
        self.others_take_over = False
        self.bus.serve(topics.EXPECT, self._expect)
        self.bus.serve(topics.TROUBLE, self._trouble)
        self.bus.serve(topics.GRANT, self._grant)
        self.bus.serve(topics.DONE, self._done)
        self.bus.serve(topics.LOST, self._lost)
        self.bus.serve(topics.PENDING, self._pending)

    @property
    def done_indices(self) -> list[int]:
        return [report.index for report in self.done]

    def go_away(self) -> None:
        self.away = {"expect", "grant", "done", "lost", "pending"}

    def _answer(self, topic: str) -> None:
        if topic in self.away:
            raise BusError(f"Nobody answered {topic}.")

    def _expect(self, request: ExpectRequest) -> Verdict:
        self._answer("expect")
        status = self.unexpected.get(request.episode.index, VerdictStatus.OK)
        return Verdict(status=status, reason="nobody leased it" if status is VerdictStatus.STALE else "")

    def _trouble(self, request: TroubleRequest) -> Verdict:
        self.troubles.append(request.reason)
        return Verdict(status=VerdictStatus.DONE if self.others_take_over else VerdictStatus.OK)

    def _grant(self, request: GrantRequest) -> Verdict:
        self._answer("grant")
        if request.index in self.done_indices:
            return Verdict(status=VerdictStatus.DONE)
        status = self.verdicts.get(request.index, VerdictStatus.OK)
        if status is VerdictStatus.OK:
            self.granted[request.index] = request.attempt
        self._answer("grant-reply")
        return Verdict(status=status)

    def _done(self, request: DoneRequest) -> Verdict:
        self._answer("done")
        if request.index in self.stale_done:
            return Verdict(status=VerdictStatus.STALE)
        self.granted.pop(request.index, None)
        self.done.append(request)
        return Verdict(status=VerdictStatus.OK)

    def _lost(self, request: LostRequest) -> Verdict:
        self._answer("lost")
        self.granted.pop(request.index, None)
        self.lost.append(request)
        return Verdict(status=VerdictStatus.OK)

    def _pending(self, request: PendingRequest) -> PendingReply:
        self._answer("pending")
        return PendingReply(
            indices=tuple(sorted(self.granted)), attempts=tuple(self.granted[index] for index in sorted(self.granted))
        )
