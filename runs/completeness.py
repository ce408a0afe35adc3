"""Checks that a data folder still holds all that its run recorded: other shards do not show a missing one."""

import os
from collections.abc import Iterable, Mapping
from pathlib import Path

from readygo.common.dataset import Defect
from readygo.common.dataset.committed import episode_indices
from readygo.common.dataset.index import load_index
from readygo.common.dataset.writer import PART_SUFFIX, recorder_of_shard
from readygo.common.errors import DatasetError, RunError
from readygo.common.messages import RunSpec
from readygo.runs.folder import RunFolder
from readygo.services.coordinator import Ledger

MISSING = "missing"
"""Kind of the defect: durable episodes are in no shard."""
_RANGES_SHOWN = 20


def check_completeness(data: Path) -> tuple[list[Defect], list[str]]:
    """Compare the shards of a data folder with the ledger of its run, and with the number of wanted episodes.

    A folder without a run's state may hold any part of a run and is not checked.

    Args:
        data: Data folder; a run may be recording into it.

    Returns:
        Defects for missing episodes, and notes that are not defects.

    Raises:
        DatasetError: If the folder of a recorder is missing.
    """
    folder = RunFolder(data)
    if not folder.state.exists():
        return [], []
    if not folder.begun:
        return [], [f"{folder.state} cannot be read: whether episodes are missing is not known."]
    try:
        spec, wanted = folder.load()
        durable = _durable(folder, spec)
    except RunError as error:
        return [], [f"Whether episodes are missing is not known: {error}"]
    found = _recorded_samples(folder, spec)
    if durable is None:
        return _without_ledger(folder, len(found), wanted)
    defects, notes = _compare(folder, durable, found)
    recorded = sum(len(episodes) for episodes in durable.values())
    if recorded < wanted:
        notes.append(f"The run is not over: {recorded} of {wanted} wanted episodes are recorded.")
    return defects, notes


def _durable(folder: RunFolder, spec: RunSpec) -> dict[str, dict[int, int]] | None:
    """Samples of every durable episode by index, by shard; None without a ledger."""
    if not folder.ledger.exists():
        return None
    if not os.access(folder.ledger, os.R_OK | os.W_OK):
        raise RunError(f"its ledger {folder.ledger} is another user's.")
    ledger = Ledger(folder.ledger, spec.stages)
    try:
        return ledger.census.shards()
    finally:
        ledger.close()


def _recorded_samples(folder: RunFolder, spec: RunSpec) -> dict[int, int | None]:
    """Samples of every episode of the run in finished shards, by index; None for one in an open shard.

    Open shards first: one may be finished meanwhile.
    """
    found: dict[int, int | None] = {}
    for part in _shards(folder, f"shard-*.mcap{PART_SUFFIX}"):
        try:
            found |= {index: None for index, _ in episode_indices(part)}
        except FileNotFoundError:
            continue
    for shard in _shards(folder, "shard-*.mcap"):
        try:
            index = load_index(shard)
        except DatasetError:
            # `validate` reports its defect.
            continue
        for row, episode in enumerate(index.episodes):
            key = index.episode_key(row)
            if (key.seed, key.split) == (spec.seed, spec.split):
                found[key.index] = int(episode["sample_count"])
    return found


def _shards(folder: RunFolder, pattern: str) -> list[Path]:
    return sorted(shard for place in folder.places for shard in place.glob(pattern))


def _compare(
    folder: RunFolder, durable: Mapping[str, Mapping[int, int]], found: Mapping[int, int | None]
) -> tuple[list[Defect], list[str]]:
    defects, notes = [], []
    elsewhere = folder.elsewhere.exists()
    for shard, episodes in sorted(durable.items()):
        missing = [index for index, samples in episodes.items() if found.get(index, -1) not in (samples, None)]
        if not missing:
            continue
        words = f"{len(missing)} of its durable episodes are in no shard: {_ranges(missing)}"
        if elsewhere and not _shards(folder, f"shard-{recorder_of_shard(shard)}-*.mcap*"):
            notes.append(f"{shard} is on the machine of its recorder: {words}.")
        else:
            defects.append(Defect(shard=shard, kind=MISSING, text=words))
    return defects, notes


def _without_ledger(folder: RunFolder, found: int, wanted: int) -> tuple[list[Defect], list[str]]:
    if not found or found >= wanted:
        return [], []
    words = f"the run's ledger is gone, and {found} of {wanted} wanted episodes are here"
    return [Defect(shard=folder.ledger.name, kind=MISSING, text=words)], []


def _ranges(indices: Iterable[int]) -> str:
    """Numbers in words, such as "3, 7-9"."""
    ranges: list[list[int]] = []
    for index in sorted(indices):
        if ranges and ranges[-1][1] == index - 1:
            ranges[-1][1] = index
        else:
            ranges.append([index, index])
    shown = [str(first) if first == last else f"{first}-{last}" for first, last in ranges[:_RANGES_SHOWN]]
    more = [f"and {len(ranges) - _RANGES_SHOWN} more ranges"] if len(ranges) > _RANGES_SHOWN else []
    return ", ".join(shown + more)
