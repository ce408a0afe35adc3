"""Who takes part in recorded episodes: the humans that the first message of each one names."""

from dataclasses import dataclass
from pathlib import Path

from readygo.common.dataset import schemas
from readygo.common.dataset.chunk import parse
from readygo.common.dataset.index import map_file
from readygo.common.dataset.records import chunk_spans, iter_messages
from readygo.common.errors import DatasetError
from readygo.common.messages.episode import EpisodeKey


@dataclass(frozen=True, kw_only=True, slots=True)
class Cast:
    """The humans of one episode."""

    episode: EpisodeKey
    avatars: tuple[str, ...]
    encounters: tuple[str, ...]
    """How each of them meets the robot's way."""


def read_casts(shard: Path) -> list[Cast]:
    """The humans of a shard's episodes, in the order of the shard; reads some hundred bytes per episode.

    Raises:
        DatasetError: If the shard is truncated or damaged.
    """
    try:
        with map_file(shard) as view:
            return [_cast(view, span.body, span.end) for span in chunk_spans(view)]
    except DatasetError as error:
        raise DatasetError(f"Shard {shard} cannot be read: {error}; see `readygo validate {shard.parent}`.") from error


def _cast(view: memoryview, body: int, end: int) -> Cast:
    first = next(iter_messages(view, body, end), None)
    if first is None or first.channel != schemas.EPISODE_START.number:
        raise DatasetError(f"the chunk at byte {body} does not begin with an episode's start")
    start = parse(schemas.EPISODE_START, view[first.body : first.end])
    return Cast(episode=schemas.episode_key(start), avatars=tuple(start.avatars), encounters=tuple(start.encounters))
