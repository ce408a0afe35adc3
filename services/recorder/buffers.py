"""Episodes on their way in."""

from collections import OrderedDict
from dataclasses import dataclass, field

from readygo.common.errors import DatasetError
from readygo.common.messages import AppendReply, AppendRequest, AppendStatus, EpisodeHeader, Sample

DAMAGED_MAX = 3
"""A batch that arrives damaged more often is no accident of the network."""


@dataclass
class EpisodeBuffer:
    """The samples of one attempt so far, in order and without gaps."""

    attempt: int
    header: EpisodeHeader
    lease: str
    """What its sender has proved to hold."""
    samples: list[Sample] = field(default_factory=list)
    size_bytes: int = 0
    damaged_count: int = 0

    @property
    def complete(self) -> bool:
        """True if all samples are there."""
        return len(self.samples) == self.header.sample_count


class EpisodeBuffers:
    """One buffer per episode, bounded in bytes."""

    def __init__(self, limit_bytes: int) -> None:
        self._limit_bytes = limit_bytes
        self._buffers: OrderedDict[int, EpisodeBuffer] = OrderedDict()

    @property
    def count(self) -> int:
        """Episodes that are coming in."""
        return len(self._buffers)

    @property
    def size_bytes(self) -> int:
        """Their images so far."""
        return sum(buffer.size_bytes for buffer in tuple(self._buffers.values()))

    def get(self, index: int) -> EpisodeBuffer | None:
        """The buffer of an episode."""
        return self._buffers.get(index)

    def drop(self, index: int) -> None:
        """Forget an episode."""
        self._buffers.pop(index, None)

    def clear(self) -> None:
        """Forget all episodes: others record them."""
        self._buffers.clear()

    def add(self, request: AppendRequest) -> AppendReply:
        """Take a batch: OK, STALE or GAP.

        A newer attempt replaces an older one. Samples that are there already are skipped.

        Raises:
            DatasetError: If the sender contradicts itself; sending again would not help.
        """
        index = request.header.episode.index
        buffer = self._buffers.get(index)
        if buffer is not None and request.attempt < buffer.attempt:
            return AppendReply(status=AppendStatus.STALE, detail=f"attempt {buffer.attempt} is being recorded")
        if buffer is None or request.attempt > buffer.attempt:
            buffer = self._buffers[index] = EpisodeBuffer(request.attempt, request.header, request.lease)
        self._buffers.move_to_end(index)
        if request.header != buffer.header:
            raise DatasetError(f"{_name(request)} came with two different headers under attempt {request.attempt}.")
        if request.first_seq > len(buffer.samples):
            return AppendReply(status=AppendStatus.GAP, expected_seq=len(buffer.samples))
        reply = _take(buffer, request)
        self._evict(index)
        return reply

    def _evict(self, current: int) -> None:
        """Drop the longest untouched buffers, never the current one: its sender would never finish."""
        while self.size_bytes > self._limit_bytes:
            oldest = next(iter(self._buffers))
            if oldest == current:
                return
            self.drop(oldest)


def _take(buffer: EpisodeBuffer, request: AppendRequest) -> AppendReply:
    for sample in request.samples[len(buffer.samples) - request.first_seq :]:
        seq = len(buffer.samples)
        if sample.seq != seq or seq >= buffer.header.sample_count:
            raise DatasetError(f"{_name(request)} sent sample {sample.seq} where {seq} was due.")
        if not sample.intact:
            buffer.damaged_count += 1
            if buffer.damaged_count > DAMAGED_MAX:
                raise DatasetError(f"{_name(request)}: sample {seq} never matches its CRC-32.")
            return AppendReply(
                status=AppendStatus.GAP, expected_seq=seq, detail=f"sample {seq} does not match its CRC-32"
            )
        buffer.samples.append(sample)
        buffer.size_bytes += sample.images_size_bytes
    if request.last and not buffer.complete:
        raise DatasetError(
            f"{_name(request)} was closed after {len(buffer.samples)} of {buffer.header.sample_count} samples."
        )
    return AppendReply(status=AppendStatus.OK)


def _name(request: AppendRequest) -> str:
    return f"Episode {request.header.episode.episode_id}"
