"""The episodes of several shards, and their order: how they were spread over the shards does not show in it."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeAlias

from readygo.common.dataset.index import ShardIndex
from readygo.common.dataset.provenance import Provenance
from readygo.common.dataset.schemas import Ending
from readygo.common.errors import DatasetError
from readygo.common.messages.episode import EpisodeKey
from readygo.common.messages.plan import DriverKind, Outcome

EpisodePlace: TypeAlias = tuple[int, int]
"""Number of a shard, and the episode's row in its index."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeEntry:
    """One episode of a dataset."""

    episode: EpisodeKey
    """Which episode of its run it is."""
    first_sample: int
    """The episode's first row in the dataset's arrays."""
    sample_count: int
    """Rows of the episode, `Dataset.clock.rate_hz` a second."""
    attempt: int
    """How often the episode was begun until it was recorded."""
    shard: Path
    """The file that holds it."""
    sha256: str
    """SHA-256 of the episode's bytes, the same on every worker."""
    outcome: Outcome = Outcome.SUCCESS
    """How it ended; the samples before a collision are there."""
    driver: DriverKind = DriverKind.EXPERT
    """Who drove."""
    policy: str = ""
    """SHA-256 over the files of the policy that drove; empty for the expert."""
    drawn: Mapping[str, float] = field(default_factory=dict, hash=False)
    """What its robot drew from the ranges of `Dataset.robot`: see `RobotConfig.with_values`."""


def episode_order(folders: Sequence[int], indexes: Sequence[ShardIndex]) -> list[EpisodePlace]:
    """Where every episode is, in the dataset's order; `folders` has the number of each shard's data folder."""

    def rank(place: EpisodePlace) -> tuple[Any, ...]:
        episode = indexes[place[0]].episodes[place[1]]
        return folders[place[0]], episode["seed"], episode["split"], episode["index"]

    places = [(shard, row) for shard, index in enumerate(indexes) for row in range(len(index.episodes))]
    return sorted(places, key=rank)


def entries_of(
    shards: Sequence[Path], indexes: Sequence[ShardIndex], order: Sequence[EpisodePlace]
) -> tuple[EpisodeEntry, ...]:
    """Every episode, in an order.

    Raises:
        DatasetError: If an episode is there twice.
    """
    entries: list[EpisodeEntry] = []
    first_sample = 0
    for shard, row in order:
        episode = indexes[shard].episodes[row]
        ending = indexes[shard].ending(row)
        entry = EpisodeEntry(
            episode=indexes[shard].episode_key(row),
            first_sample=first_sample,
            sample_count=int(episode["sample_count"]),
            attempt=int(episode["attempt"]),
            shard=shards[shard],
            sha256=episode["sha256"].decode(),
            outcome=ending.outcome,
            driver=ending.driver,
            policy=_policy_of(ending, indexes[shard].provenance),
            drawn=indexes[shard].drawn[row] if indexes[shard].drawn else {},
        )
        entries.append(entry)
        first_sample += entry.sample_count
    _check_unique(entries)
    return tuple(entries)


def _policy_of(ending: Ending, provenance: Provenance) -> str:
    """The policy that drove an episode: the offered one that it names, else the run's own."""
    own = provenance.policy.sha256 if provenance.policy and ending.driver is DriverKind.POLICY else ""
    return ending.policy or own


def _check_unique(episodes: Sequence[EpisodeEntry]) -> None:
    """Raise DatasetError if an episode is there twice; other scenes may use the same keys."""
    seen: dict[str, EpisodeEntry] = {}
    for entry in episodes:
        if entry.sha256 in seen:
            raise DatasetError(
                f"Episode {entry.episode.episode_id} is there twice, in {seen[entry.sha256].shard} and {entry.shard}; "
                "give every folder once, or have `readygo recover` leave one of two in a folder."
            )
        seen[entry.sha256] = entry
