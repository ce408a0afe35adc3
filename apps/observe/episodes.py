"""Durations of episodes, from their first lease until they are durable, from the coordinator's requests."""

import time
from collections import OrderedDict
from collections.abc import Callable
from typing import Any

from readygo.common.messages import ClaimReply, DoneRequest, EpisodeKey, Verdict, VerdictStatus

EPISODES_MAX = 100_000
"""Largest number of running episodes to track."""


class EpisodeClock:
    """Measures episodes by the coordinator's replies."""

    def __init__(self, done: Callable[[str, int, int, int, int], None], clock_ns: Callable[[], int] = time.time_ns):
        """Begin without running episodes.

        Args:
            done: Called with episode, begin and end by the wall clock [ns], attempts and samples.
            clock_ns: Returns the wall clock [ns].
        """
        self._done, self._clock_ns = done, clock_ns
        self._under_way: OrderedDict[int, tuple[EpisodeKey, int]] = OrderedDict()

    def answered(self, topic: str, request: Any, reply: Any) -> None:
        """Process a handled request."""
        if isinstance(reply, ClaimReply) and reply.episode is not None:
            self._under_way.setdefault(reply.episode.index, (reply.episode, self._clock_ns()))
            while len(self._under_way) > EPISODES_MAX:
                self._under_way.popitem(last=False)
        elif isinstance(request, DoneRequest) and isinstance(reply, Verdict) and reply.status is VerdictStatus.OK:
            begun = self._under_way.pop(request.index, None)
            if begun is not None:
                self._done(begun[0].episode_id, begun[1], self._clock_ns(), request.attempt, request.sample_count)
