"""What this thread works on: read by code that logs, counts or traces it."""

from collections.abc import Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True)
class AtWork:
    """One attempt at one stage of an episode."""

    stage: str
    episode: str
    """Name of the episode, as `EpisodeKey.episode_id`."""
    attempt: int


AT_WORK: ContextVar[AtWork | None] = ContextVar("at_work", default=None)


@contextmanager
def working(*, stage: str, episode: str, attempt: int) -> Iterator[None]:
    """Say what is worked on for as long as the block runs."""
    before = AT_WORK.set(AtWork(stage=stage, episode=episode, attempt=attempt))
    try:
        yield
    finally:
        AT_WORK.reset(before)
