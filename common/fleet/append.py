"""A worker's way of giving an episode to its recorder."""

import time
from collections.abc import Iterator
from itertools import islice

from readygo.common.bus import Bus
from readygo.common.errors import BusError, PeerError, RunError
from readygo.common.fleet.shown import show_newest
from readygo.common.messages import (
    AppendReply,
    AppendRequest,
    AppendStatus,
    ClaimReply,
    EpisodeHeader,
    Sample,
    topics,
)

BATCH = 8
"""Samples per append: the recorder's acknowledgement costs less than the images from here on."""
RECORDER_ABSENT_S = 60.0
_RETRY_S = 0.2


def append_episode(bus: Bus, claim: ClaimReply, header: EpisodeHeader, samples: Iterator[Sample]) -> None:
    """Send an episode to its recorder in acknowledged batches, until it is durable or the attempt is stale.

    Raises:
        RunError: If the recorder refuses the samples.
        BusError: If it stays away.
    """
    sent: list[Sample] = []
    acknowledged = 0
    while acknowledged < header.sample_count:
        while len(sent) < min(acknowledged + BATCH, header.sample_count):
            sent.extend(islice(samples, acknowledged + BATCH - len(sent)))
        show_newest(bus, header, sent)
        batch = tuple(sent[acknowledged : acknowledged + BATCH])
        last = acknowledged + len(batch) == header.sample_count
        request = AppendRequest(
            attempt=claim.attempt,
            header=header,
            first_seq=acknowledged,
            samples=batch,
            last=last,
            lease=claim.lease,
        )
        reply = _append(bus, claim.recorder, request)
        if reply.status is AppendStatus.GAP:
            acknowledged = reply.expected_seq
        elif reply.status is AppendStatus.OK:
            acknowledged += len(batch)
        else:
            return


def _append(bus: Bus, recorder: str, request: AppendRequest) -> AppendReply:
    """Send a batch until the recorder takes it or has done with the episode, however long its disk is full."""
    deadline_s = time.monotonic() + RECORDER_ABSENT_S
    while True:
        try:
            reply = bus.request(topics.append(recorder), request, timeout_s=20.0)
        except PeerError as error:
            raise RunError(f"Recorder {recorder} refused the samples: {error}") from error
        except BusError:
            if time.monotonic() > deadline_s:
                raise
        else:
            if reply.status is not AppendStatus.RETRY:
                return reply
            deadline_s = time.monotonic() + RECORDER_ABSENT_S
        time.sleep(_RETRY_S)
