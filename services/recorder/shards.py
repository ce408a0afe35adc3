"""The shards of one recorder: finished ones, the one that it writes, and what a crash left open."""

from collections.abc import Callable, Iterable
from contextlib import suppress
from pathlib import Path

from readygo.common.dataset import EpisodeChunk, Provenance, ShardPlace, ShardWriter, shard_name
from readygo.common.dataset.stage import Scenery
from readygo.common.errors import RunError
from readygo.services.recorder.config import RecorderConfig
from readygo.services.recorder.disk import disk_error
from readygo.services.recorder.salvage import (
    Durable,
    OpenShard,
    finished_episodes,
    next_number,
    next_start_ns,
    open_shards,
    publish,
)


class Shards:
    """What is durable of a recorder's name in a folder; for one thread at a time."""

    def __init__(self, folder: Path, name: str, provenance: Provenance, config: RecorderConfig, stage: Scenery) -> None:
        """Read what is there.

        Args:
            folder: Where the shards are.
            name: Part of their names.
            provenance: What every shard says about its run.
            config: Settings.
            stage: What viewers show around the samples.

        Raises:
            DatasetError: If a finished shard is damaged.
        """
        self.folder = folder
        self._name = name
        self._provenance = provenance
        self._config = config
        self._stage = stage
        self._writer: ShardWriter | None = None
        self.durable = finished_episodes(folder, name)
        """Every episode that is in a shard, by index."""
        self._left_open: list[OpenShard] = open_shards(folder, name)
        self._next_start_ns = next_start_ns(folder, name)

    def place(self, outputs: tuple[str, ...]) -> ShardPlace:
        """Place of the next episode, which has these outputs."""
        with_map = self._writer is None or self._must_end(outputs)
        return ShardPlace(stage=self._stage, start_ns=self._next_start_ns, with_map=with_map)

    def write(self, chunk: EpisodeChunk) -> Durable:
        """Make an episode durable that was encoded for its `place`.

        Raises:
            RunError: If the disk refuses; DiskError if it can be waited for.
        """
        try:
            if self._must_end(tuple(chunk.outputs)):
                self.close()
            writer = self._open(chunk.outputs)
            writer.append(chunk, placed=True)
        except OSError as error:
            raise disk_error(self.folder, error) from error
        self._next_start_ns = writer.next_start_ns
        durable = self.durable[chunk.episode.index] = Durable.of_chunk(chunk, writer.path.name)
        return durable

    def finish_full(self) -> None:
        """Finish the open shard if it is full; if that fails, the next episode tries again and says what is wrong."""
        if self._is_full():
            with suppress(RunError):
                self.close()

    def close(self) -> None:
        """Finish the open shard.

        Raises:
            RunError: If the disk refuses.
        """
        if self._writer is None:
            return
        try:
            self._writer.close()
        except OSError as error:
            raise disk_error(self.folder, error) from error
        self._writer = None

    def leave_open(self) -> None:
        """Leave the open shard as a crash would: the next process of the name saves what is in it."""
        if self._writer is not None:
            self._writer.abandon()
            self._writer = None

    def leave_broken(self) -> None:
        """Leave an open shard to `salvage` that could not be cut back to whole episodes; they are not durable yet."""
        if self._writer is not None and not self._writer.is_open:
            gone, self._writer = self._writer.path.name, None
            self.durable = {index: durable for index, durable in self.durable.items() if durable.shard != gone}
            self._left_open = open_shards(self.folder, self._name)

    def salvage(self, is_ours: Callable[[Durable], bool]) -> None:
        """Finish the shards that a crash left open, without the episodes that are elsewhere by now.

        Args:
            is_ours: Tells whether an episode is this recorder's.

        Raises:
            RunError: If the disk refuses; DiskError if it can be waited for.
        """
        while self._left_open:
            self._salvage(self._left_open[0], is_ours)
            self._left_open.pop(0)

    def _salvage(self, shard: OpenShard, is_ours: Callable[[Durable], bool]) -> None:
        target = self.folder / shard.path.stem
        if target.exists():
            target = self._new_path()
        kept: dict[int, EpisodeChunk] = {}
        for chunk in shard.chunks:
            index = chunk.episode.index
            known = index in self.durable or index in kept
            if not known and is_ours(Durable.of_chunk(chunk, target.name)):
                kept[index] = chunk
        try:
            self._next_start_ns = publish(
                shard,
                tuple(kept.values()),
                target,
                stage=self._stage,
                start_ns=self._next_start_ns,
                fsync=self._config.fsync,
            )
        except OSError as error:
            raise disk_error(self.folder, error) from error
        self.durable.update({index: Durable.of_chunk(chunk, target.name) for index, chunk in kept.items()})

    def _open(self, outputs: Iterable[str]) -> ShardWriter:
        """The open shard, a new one for these outputs if there is none."""
        if self._writer is None:
            self._writer = ShardWriter(
                self._new_path(),
                self._provenance,
                outputs=outputs,
                stage=self._stage,
                start_ns=self._next_start_ns,
                fsync=self._config.fsync,
            )
        return self._writer

    def _new_path(self) -> Path:
        return self.folder / shard_name(self._name, next_number(self.folder, self._name))

    def _is_full(self) -> bool:
        return self._writer is not None and self._writer.episode_count >= self._config.episodes_per_shard

    def _must_end(self, outputs: tuple[str, ...]) -> bool:
        """True if the open shard takes no episode with these outputs."""
        return self._is_full() or (self._writer is not None and self._writer.outputs != outputs)
