"""The source of an export: the episodes of a dataset, their rows at a rate, and their division into parts."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise
from pathlib import Path

import numpy as np

from readygo.common.arrays import AnyArray, Float32Array, Int64Array
from readygo.common.dataset import Dataset, EpisodeEntry
from readygo.common.errors import ConfigError
from readygo.common.messages import Split

SPLITS = tuple(Split)
"""Splits in the order of the export."""


@dataclass(frozen=True, kw_only=True, eq=False)
class ExportedEpisode:
    """One episode as rows; each has an image."""

    number: int
    """Number of the episode in the export."""
    first_row: int
    """Number of its first row in the export."""
    entry: EpisodeEntry
    dataset: Dataset
    samples: Int64Array
    """Sample of each row, shape (T,)."""

    def __len__(self) -> int:
        return len(self.samples)

    @property
    def name(self) -> str:
        """Name of the episode, unique even if several runs use the same keys."""
        return f"{self.number:06d}-{self.entry.episode.episode_id}"

    @property
    def facts(self) -> dict[str, str | int]:
        """Values that are constant over the episode's rows."""
        entry = self.entry
        return {
            "episode_id": entry.episode.episode_id,
            "split": entry.episode.split.value,
            "seed": entry.episode.seed,
            "outcome": entry.outcome.value,
            "driver": entry.driver.value,
            "policy": entry.policy,
            "sha256": entry.sha256,
        }

    def images(self, output: str = "rgb") -> Iterator[bytes]:
        """The encoded images of an output, row by row."""
        return (self.dataset.output(int(sample), output) for sample in self.samples)

    @cached_property
    def columns(self) -> dict[str, AnyArray]:
        """The numbers of all rows by name, shape (T,) or (T, n); docs/export.md describes them."""
        dataset, truth = self.dataset, self.dataset.truth[self.samples]
        actions = self._mean_commands(dataset.actions)
        labels = {"expert_action": self._mean_commands(dataset.expert_actions)} if dataset.has_expert else {}
        before = np.vstack([np.zeros((1, 2), np.float32), actions[:-1]])
        return {
            "time_s": (dataset.time_ns[self.samples] / 1e9).astype(np.float32),
            "action": actions,
            **labels,
            "goal_xy_m": dataset.goals_xy_m[self.samples],
            "velocity": before,
            "pose": dataset.poses[self.samples].astype(np.float32),
            "human_distance_m": truth["human_distance_m"],
            "time_to_collision_s": truth["time_to_collision_s"],
            "human_visible": truth["human_visible"],
            "replanned": truth["replanned"],
            "is_last": np.arange(len(self)) == len(self) - 1,
        }

    def _mean_commands(self, commands: Float32Array) -> Float32Array:
        """The mean command from each row to the next one, shape (T, 2); NaN, where none is known, does not count."""
        first, end = self.entry.first_sample, self.entry.first_sample + self.entry.sample_count
        starts = self.samples - first
        here = commands[first:end].astype(np.float64)
        counts = np.add.reduceat(~np.isnan(here), starts, axis=0, dtype=np.int64)
        with np.errstate(invalid="ignore"):
            return (np.add.reduceat(np.nan_to_num(here), starts, axis=0) / counts).astype(np.float32)


@dataclass(frozen=True)
class ExportPart:
    """Episodes that are written together: the unit in which an export stops and resumes."""

    number: int
    """Number of the part among all parts."""
    split: Split
    number_in_split: int
    episodes: range
    """Numbers of its episodes."""


class ExportSource:
    """The episodes of some data folders in the order of an export: training, validation, test."""

    def __init__(self, folders: Sequence[Path], rate_hz: int | None = None) -> None:
        """Open the folders.

        Args:
            folders: Data folders.
            rate_hz: Rows per second [Hz]; by default one row per image.

        Raises:
            DatasetError: If there is no readable dataset.
            ConfigError: If a row would have no image.
        """
        self.folders = tuple(folders)
        self.dataset = Dataset(self.folders)
        self.stride = _stride(self.dataset, rate_hz)
        entries = self.dataset.episodes
        self._entries = sorted(entries, key=lambda entry: (SPLITS.index(entry.episode.split), entry.first_sample))
        lengths = [len(_samples(entry, self.stride)) for entry in self._entries]
        self._first_rows = np.concatenate([[0], np.cumsum(lengths)])

    @property
    def rate_hz(self) -> int:
        """Rows per second [Hz]."""
        return self.dataset.clock.rate_hz // self.stride

    @property
    def row_count(self) -> int:
        """Number of rows of all episodes."""
        return int(self._first_rows[-1])

    @property
    def episode_count(self) -> int:
        """Number of episodes."""
        return len(self._entries)

    def episode(self, number: int) -> ExportedEpisode:
        """An episode by its number."""
        entry = self._entries[number]
        return ExportedEpisode(
            number=number,
            first_row=int(self._first_rows[number]),
            entry=entry,
            dataset=self.dataset,
            samples=_samples(entry, self.stride),
        )

    def of_split(self, split: Split) -> range:
        """The numbers of a split's episodes."""
        numbers = [number for number, entry in enumerate(self._entries) if entry.episode.split is split]
        return range(numbers[0], numbers[-1] + 1) if numbers else range(0)

    def parts(self, size_bytes: int) -> list[ExportPart]:
        """Parts of consecutive episodes of one split, each with about `size_bytes` of images or one larger episode."""
        parts: list[ExportPart] = []
        for split in SPLITS:
            begins = self._begins(self.of_split(split), size_bytes)
            for position, (begin, end) in enumerate(pairwise(begins)):
                parts.append(ExportPart(len(parts), split, position, range(begin, end)))
        return parts

    def _begins(self, numbers: range, size_bytes: int) -> list[int]:
        """First numbers of the parts of a split, and the end of the last one."""
        begins, size = [], float("inf")
        for number in numbers:
            more = self._size_bytes(number)
            if size + more > size_bytes:
                begins.append(number)
                size = 0
            size += more
        return [*begins, numbers.stop] if begins else []

    def _size_bytes(self, number: int) -> int:
        return int(self.dataset.image_sizes[_samples(self._entries[number], self.stride)].sum())


def _samples(entry: EpisodeEntry, stride: int) -> Int64Array:
    return np.arange(entry.first_sample, entry.first_sample + entry.sample_count, stride, dtype=np.int64)


def _stride(dataset: Dataset, rate_hz: int | None) -> int:
    """Number of samples from row to row, such that every row has an image."""
    all_hz = dataset.clock.rate_hz
    fitting = [stride for stride in range(1, all_hz + 1) if all_hz % stride == 0 and _all_pictured(dataset, stride)]
    rates = [all_hz // stride for stride in fitting]
    if rate_hz is not None and rate_hz not in rates:
        raise ConfigError(f"--rate-hz {rate_hz} does not fit these images; possible are {', '.join(map(str, rates))}.")
    if not fitting:
        raise ConfigError("The images of these episodes are at no common rate; export the folders one by one.")
    return fitting[0] if rate_hz is None else all_hz // rate_hz


def _all_pictured(dataset: Dataset, stride: int) -> bool:
    return all(bool(dataset.pictured[_samples(entry, stride)].all()) for entry in dataset.episodes)
