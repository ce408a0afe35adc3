"""What the coordinator must hear from a recorder, sent until it is acknowledged."""

from collections import deque

from readygo.common.bus import Bus
from readygo.common.errors import BusError, RunError
from readygo.common.messages import DoneRequest, LostRequest, Verdict


class Reports:
    """Reports in the order in which things happened."""

    def __init__(self, bus: Bus, timeout_s: float) -> None:
        self._bus = bus
        self._timeout_s = timeout_s
        self._waiting: deque[DoneRequest | LostRequest] = deque()

    def add(self, report: DoneRequest | LostRequest) -> None:
        """Queue a report."""
        self._waiting.append(report)

    def flush(self) -> bool:
        """Send what waits; False if the coordinator does not answer, the rest then waits on.

        Raises:
            RunError: If the coordinator has given away an episode that this recorder has made durable.
        """
        while self._waiting:
            report = self._waiting[0]
            topic = "coord/rec/done" if isinstance(report, DoneRequest) else "coord/rec/lost"
            try:
                verdict = self._bus.request(topic, report, Verdict, timeout_s=self._timeout_s)
            except BusError:
                return False
            self._waiting.popleft()
            if isinstance(report, DoneRequest) and verdict.status == "stale":
                raise RunError(
                    f"Episode {report.index} is in {report.shard}, but the coordinator gave it to another recorder; "
                    "remove one of the two shards and run the same command again."
                )
        return True
