"""A bounded set of episodes that keeps a share of every round."""

import hashlib
import heapq
from dataclasses import dataclass, field

from readygo.services.trainer.episodes import TrainingEpisode


@dataclass
class Round:
    """What one policy drove, or the expert."""

    size_bytes: int = 0
    lots: list[tuple[bytes, str]] = field(default_factory=list)
    """A heap of the lots that its episodes drew, with their names."""


class Reservoir:
    """Episodes up to a size; which ones are kept is a function of the seed and of what was added.

    When room runs out, the largest round gives up the episode that drew the lowest lot: within a round every episode is
    as likely to stay, and no round crowds out another one.
    """

    def __init__(self, limit_bytes: int, seed: int = 0) -> None:
        self.episodes: dict[str, TrainingEpisode] = {}
        """Episodes by name, in the order in which they came."""
        self.size_bytes = 0
        self.version = 0
        """Changes with the contents."""
        self._limit_bytes, self._seed = limit_bytes, seed
        self._rounds: dict[str, Round] = {}

    def add(self, episode: TrainingEpisode) -> None:
        """Take an episode, and let others go if there is no room; one that is there already is left as it is."""
        if episode.name in self.episodes or not episode.sample_count:
            return
        lot = hashlib.sha256(f"{self._seed}/{episode.name}".encode()).digest()
        heapq.heappush(self._rounds.setdefault(episode.policy, Round()).lots, (lot, episode.name))
        self.episodes[episode.name] = episode
        self._count(episode, episode.size_bytes)
        while self.size_bytes > self._limit_bytes and len(self.episodes) > 1:
            largest = max(self._rounds.items(), key=lambda item: (item[1].size_bytes, item[0]))[1]
            dropped = self.episodes.pop(heapq.heappop(largest.lots)[1])
            self._count(dropped, -dropped.size_bytes)

    def _count(self, episode: TrainingEpisode, size_bytes: int) -> None:
        self.size_bytes += size_bytes
        self._rounds[episode.policy].size_bytes += size_bytes
        self.version += 1
