"""The hall of the episodes' tests."""

from tests.common.episode.conftest import hall

__all__ = ["hall"]
