"""Durations of episodes, from their first lease until they are durable, from the coordinator's requests."""

import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from readygo.common.messages import ClaimReply, DoneRequest, Verdict, VerdictStatus

EPISODES_MAX = 100_000
"""Largest number of running episodes to track."""


class EpisodeClock:
    """Measures episodes by the coordinator's replies."""

    def __init__(self, done: Callable[[float], None], clock_s: Callable[[], float] = time.monotonic) -> None:
        """Begin without running episodes.

        Args:
            done: Called with the duration of an episode [s].
            clock_s: Returns the time [s].
        """
        self._done, self._clock_s = done, clock_s
        self._under_way: OrderedDict[int, float] = OrderedDict()

    def observe_reply(self, request: Any, reply: Any) -> None:
        """Process a handled request."""
        if isinstance(reply, ClaimReply) and reply.episode is not None:
            self._under_way.setdefault(reply.episode.index, self._clock_s())
            while len(self._under_way) > EPISODES_MAX:
                self._under_way.popitem(last=False)
        elif isinstance(request, DoneRequest) and isinstance(reply, Verdict) and reply.status is VerdictStatus.OK:
            begun_s = self._under_way.pop(request.index, None)
            if begun_s is not None:
                self._done(self._clock_s() - begun_s)
