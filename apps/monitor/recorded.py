"""Read-only access to the durable episodes of a data folder, also while it is written."""

import threading
from collections import OrderedDict
from pathlib import Path

from readygo.apps.monitor.track import EpisodeTrack, track_of
from readygo.common.dataset.committed import committed_episode, episode_keys
from readygo.common.dataset.index import index_path, read_index
from readygo.common.dataset.places import absent, present_folders
from readygo.common.errors import DatasetError
from readygo.common.messages import EpisodeKey, Outcome

TRACKS_MAX = 4
"""Number of episodes in memory, with images about 2 MB each."""


class Recorded:
    """Lists and reads episodes; thread-safe."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.absent = ""
        """Shards that cannot be shown, with the reasons; empty if all can."""
        self._listing, self._reading = threading.Lock(), threading.Lock()
        self._shards: dict[Path, dict[EpisodeKey, Outcome | None]] = {}
        """Episodes of finished shards, which no longer change."""
        self._tracks: OrderedDict[EpisodeKey, EpisodeTrack] = OrderedDict()

    def episodes(self) -> dict[EpisodeKey, Outcome | None]:
        """Outcome of every durable episode, in order; None if it is unknown without reading the episode."""
        with self._listing:
            folders = self._folders()
            parts = (part for folder in folders for part in folder.glob("shard-*.mcap.part"))
            found = dict(entry for part in parts for entry in _list_outcomes(part).items())
            for shard in (shard for folder in folders for shard in folder.glob("shard-*.mcap")):
                if shard not in self._shards:
                    self._shards[shard] = _list_outcomes(shard)
                found.update(self._shards[shard])
        return dict(sorted(found.items(), key=lambda entry: _rank(entry[0])))

    def track(self, episode: EpisodeKey) -> EpisodeTrack | None:
        """Read an episode; None if it does not exist.

        Raises:
            DatasetError: If its shard is damaged.
        """
        with self._reading:
            if episode not in self._tracks:
                committed = committed_episode(self._folders(), episode)
                if committed is None or not committed.samples:
                    return None
                self._tracks[episode] = track_of(committed)
                while len(self._tracks) > TRACKS_MAX:
                    self._tracks.popitem(last=False)
            self._tracks.move_to_end(episode)
            return self._tracks[episode]

    def _folders(self) -> list[Path]:
        """The existing folders with shards: those of recorders with separate disks may come and go."""
        try:
            self.absent, folders = absent(self.folder), present_folders(self.folder)
        except DatasetError as error:
            self.absent, folders = str(error), [self.folder]
        return folders


def _list_outcomes(shard: Path) -> dict[EpisodeKey, Outcome | None]:
    index = read_index(index_path(shard)) if shard.suffix == ".mcap" else None
    if index is None:
        return dict.fromkeys(episode_keys(shard))
    return {index.episode_key(row): index.ending(row).outcome for row in range(len(index.episodes))}


def _rank(key: EpisodeKey) -> tuple[int, str, int]:
    return key.seed, key.split.value, key.index
