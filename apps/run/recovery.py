"""A run's ledger and its shards, brought in line again: whatever of the two was lost or damaged.

Shards are what counts. A ledger that is gone is made anew of them; an episode that is in no sound shard any more is
recorded again. A damaged shard becomes an open one, of which its recorder saves what is whole, as after a crash. Of an
episode that lies in several shards the first one by name keeps its copy, the others are written again without theirs.
"""

import json
import logging
import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from readygo.apps.run.config import config_of
from readygo.apps.run.folder import RunFolder
from readygo.apps.run.recorders import keep_retired
from readygo.common.dataset.committed import episode_indices, episode_keys
from readygo.common.dataset.index import DATA_END_SIZE, ShardIndex, index_path, load_index, mapped, tail_offset
from readygo.common.dataset.records import RECORD_HEADER
from readygo.common.dataset.writer import PART_SUFFIX, is_shard_of, recorder_of_shard, shard_name
from readygo.common.documents import read_json
from readygo.common.errors import DatasetError, DiskError, RunError
from readygo.common.files import write_whole
from readygo.common.messages import EpisodeKey, RunSpec, Stage
from readygo.services.coordinator import Ledger, Written
from readygo.services.recorder.salvage import drop_episodes, next_number

log = logging.getLogger(__name__)

SHARDS = "shard-*.mcap"


@dataclass(kw_only=True)
class Findings:
    """What was not as it was left."""

    rebuilt: bool = False
    """True if the ledger was made anew."""
    damaged: dict[Path, str] = field(default_factory=dict)
    """Why, by the shard that is damaged."""
    doubles: dict[Path, int] = field(default_factory=dict)
    """How many episodes another shard keeps, by the shard that had them as well."""
    lost: list[int] = field(default_factory=list)
    """Episodes that were durable and are in no sound shard: they are recorded again, but for what is saved."""

    @property
    def lines(self) -> list[str]:
        """All of it in words."""
        lines = ["The run's ledger was lost or damaged: it is made anew of the shards."] if self.rebuilt else []
        lines += [
            f"{shard.name} is damaged ({why}): what is whole in it is saved." for shard, why in self.damaged.items()
        ]
        lines += [
            f"{shard.name} had {count} episodes that are in other shards as well: they are dropped from it."
            for shard, count in self.doubles.items()
        ]
        if self.lost:
            lines.append(
                f"{len(self.lost)} durable episodes are in no sound shard: what cannot be saved is recorded again."
            )
        return lines


def recover(folder: RunFolder, *, every_byte: bool = False, recorded_here: bool = True) -> Findings:
    """Bring a run's ledger and shards in line; call it with the folder's lock, before the run goes on.

    Args:
        folder: Of a run, with its spec.
        every_byte: Also read shards again that were found sound before and have not changed since.
        recorded_here: False where recorders have disks on other machines: what the ledger says of those that have no
            shard here is taken for true, no ledger is made anew without their shards, and episodes that are there
            twice stay so: a recorder may be at work on them.

    Raises:
        RunError: If the folder cannot be written, a ledger is lost that cannot be made anew, or `recorded_here` is not
            true of the folder.
    """
    if not recorded_here and not folder.ledger.exists() and folder.blobs.exists():
        raise _not_made_anew(folder, f"The run's ledger {folder.ledger} is gone.")
    if not folder.has_data:
        return Findings()
    if recorded_here and folder.elsewhere.exists():
        raise RunError(
            f"Shards of {folder.path} are on other machines: `readygo coordinator {folder.path}` goes on with the run, "
            "after `readygo requeue` if one of its recorders has lost its disk."
        )
    spec, wanted = folder.load()
    findings = Findings()
    sound = _sound_shards(folder, findings, every_byte=every_byte)
    for shard in findings.damaged:
        _reopen(shard)
    if recorded_here:
        _settle_doubles(folder, sound, spec, findings)
    named = _by_name(folder, sound)
    ledger = _open_ledger(folder, spec.stages, findings, recorded_here=recorded_here)
    try:
        keep_retired(folder, ledger)
        lost = _give_back(ledger, folder, named, recorded_here=recorded_here)
        findings.lost = sorted(lost - _adopted(ledger, named, spec))
        if recorded_here:
            _entrust_open_shards(ledger, folder, spec)
        if findings.rebuilt:
            indices = [index for shard in _shards(folder, f"{SHARDS}*") for index in _indices(shard)]
            ledger.fill_gaps(max(indices, default=-1), wanted)
    finally:
        ledger.close()
    for line in findings.lines:
        log.warning("%s", line)
    return findings


def check_recorded(folder: RunFolder) -> None:
    """See whether every episode that a run's ledger calls durable is in a shard that can be read.

    Raises:
        RunError: If one is not.
    """
    spec, _ = folder.load()
    findings = Findings()
    sound = _by_name(folder, _sound_shards(folder, findings))
    ledger = Ledger(folder.ledger, spec.stages)
    shards = ledger.census.shards()
    ledger.close()
    missing = sum(len(_missing(episodes, sound.get(name))) for name, episodes in shards.items())
    if missing:
        why = "; ".join(f"{shard.name}: {why}" for shard, why in findings.damaged.items()) or "their shards are gone"
        raise RunError(
            f"{missing} recorded episodes of {folder.path} cannot be read ({why}); run the same command again, or "
            f"`readygo recover {folder.path}`, to record them anew."
        )


class Witness:
    """Tells whether an episode is in a recorder's shards; what was read of a shard once is not read again."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._read: dict[str, tuple[int, set[int]]] = {}

    def holds_episode(self, recorder: str, shard: str, index: int) -> bool:
        """True if a recorder's shard, or one that it has not finished, begins an episode of this index.

        False for a name that none of its shards can have: whoever may report might report anything.
        """
        if not is_shard_of(shard, recorder):
            return False
        name, folder = shard, self._folder.place_of(recorder)
        open_shards = sorted(folder.glob(f"shard-{recorder}-*.mcap{PART_SUFFIX}"), reverse=True)
        places = [folder / name, folder / (name + PART_SUFFIX), *open_shards]
        return any(index in self._indices(path) for path in dict.fromkeys(places))

    def _indices(self, shard: Path) -> set[int]:
        if not shard.is_file():
            return set()
        name = shard.name.removesuffix(PART_SUFFIX)
        end, found = self._read.get(name, (0, set()))
        if shard.stat().st_size < end:
            # Another file than the one that was read.
            end, found = 0, set()
        for index, after in episode_indices(shard, end):
            end = after
            found.add(index)
        self._read[name] = end, found
        return found


def _shards(folder: RunFolder, pattern: str) -> list[Path]:
    return sorted(shard for place in folder.places for shard in place.glob(pattern))


def _indices(shard: Path) -> list[int]:
    """Indices of the episodes in a shard, finished or not; none of a file that is none."""
    return [index for index, _ in episode_indices(shard)] if shard.is_file() and shard.suffix != ".index" else []


def _sound_shards(folder: RunFolder, findings: Findings, *, every_byte: bool = False) -> dict[Path, ShardIndex]:
    """The finished shards that can be read; the others go into the findings.

    Those whose bytes were found to match their checksum once are not read again while size and time stay.
    """
    note = folder.state / "sound.json"
    known = {} if every_byte else _read_note(note)
    sound: dict[Path, ShardIndex] = {}
    stamps: dict[str, list[int]] = {}
    for shard in _shards(folder, SHARDS):
        stat = shard.stat()
        stamp = [stat.st_size, stat.st_mtime_ns]
        try:
            if known.get(shard.name) != stamp:
                _check_bytes(shard)
            sound[shard] = load_index(shard)
            stamps[shard.name] = stamp
        except DatasetError as error:
            findings.damaged[shard] = str(error).split(";")[0]
    if stamps != known:
        write_whole(note, json.dumps(stamps), raises=RunError)
    return sound


def _by_name(folder: RunFolder, sound: Mapping[Path, ShardIndex]) -> dict[str, ShardIndex]:
    """Shards by name; of two that share one it is that of the shard which lies where its recorder writes."""
    placed_last = sorted(sound, key=lambda shard: _is_placed(folder, shard))
    return {shard.name: sound[shard] for shard in placed_last}


def _read_note(note: Path) -> dict[str, list[int]]:
    try:
        stamps = read_json(note)
    except (OSError, ValueError):
        return {}
    return stamps if isinstance(stamps, dict) else {}


def _check_bytes(shard: Path) -> None:
    """Raise DatasetError unless a finished shard's bytes match the checksum at their end."""
    with mapped(shard) as view:
        end = tail_offset(view, shard)
        stored = int.from_bytes(view[end + RECORD_HEADER.size : end + DATA_END_SIZE], "little")
        if zlib.crc32(view[:end]) != stored:
            raise DatasetError(f"Shard {shard} does not match its CRC-32")


def _reopen(shard: Path) -> None:
    """Make a damaged shard an open one, of which its recorder saves the whole episodes when it starts."""
    part = shard.with_name(shard.name + PART_SUFFIX)
    if part.exists():
        # Left by a crash: each of the two may hold what the other has not.
        recorder = recorder_of_shard(shard.name)
        part = shard.with_name(shard_name(recorder, next_number(shard.parent, recorder)) + PART_SUFFIX)
    index_path(shard).unlink(missing_ok=True)
    shard.rename(part)


def _settle_doubles(folder: RunFolder, sound: dict[Path, ShardIndex], spec: RunSpec, findings: Findings) -> None:
    """Leave one copy of every episode; `sound` is then what is left of the shards."""
    seen: set[EpisodeKey] = set()
    for shard in sorted(sound, key=lambda shard: (not _is_placed(folder, shard), shard.name)):
        double: set[int] = set()
        for row in range(len(sound[shard].episodes)):
            key = sound[shard].episode_key(row)
            if key in seen:
                double.add(row)
            seen.add(key)
        if double:
            findings.doubles[shard] = len(double)
            del sound[shard]
            if _without(shard, double, spec):
                sound[shard] = load_index(shard)


def _is_placed(folder: RunFolder, shard: Path) -> bool:
    """False for a shard that lies where its recorder does not write."""
    return shard == folder.shard(shard.name)


def _without(shard: Path, rows: Collection[int], spec: RunSpec) -> bool:
    """Leave episodes of a shard out; False if none is left."""
    # Only here: it brings what all stages need.
    from readygo.apps.run.world import World

    try:
        return drop_episodes(shard, rows, World(spec).stage())
    except OSError as error:
        raise RunError(
            f"{shard} cannot be written without what other shards hold as well: {error.strerror or error}."
        ) from error


def _not_made_anew(folder: RunFolder, why: str) -> RunError:
    return RunError(
        f"{why} Its recorders are on other machines: gather their shards in {folder.path}, and run "
        f"`readygo recover {folder.path}`, which makes it anew of them."
    )


def _open_ledger(folder: RunFolder, stages: tuple[Stage, ...], findings: Findings, *, recorded_here: bool) -> Ledger:
    """The run's ledger; a new one where it is damaged, or gone although there are shards.

    One that was being made anew when its process ended is gone on with. A full disk is no damage.
    """
    new = not folder.ledger.exists()
    damaged = False
    try:
        ledger = Ledger(folder.ledger, stages)
        ledger.check()
    except DiskError:
        raise
    except RunError as error:
        if new:
            raise
        if not recorded_here:
            raise _not_made_anew(folder, str(error)) from error
        log.warning("%s", error)
        for suffix in ("", "-wal", "-shm"):
            file = folder.ledger.with_name(folder.ledger.name + suffix)
            if file.exists():
                file.replace(file.with_name(f"damaged-{file.name}"))
        ledger, damaged = Ledger(folder.ledger, stages), True
    findings.rebuilt = damaged or (ledger.unfinished and bool(_shards(folder, f"{SHARDS}*")))
    if findings.rebuilt and not recorded_here:
        ledger.close()
        raise _not_made_anew(folder, f"The run's ledger {folder.ledger} was lost and is half made anew.")
    if findings.rebuilt:
        ledger.begin_rebuild()
    return ledger


def _adopted(ledger: Ledger, sound: Mapping[str, ShardIndex], spec: RunSpec) -> set[int]:
    """Note the episodes of sound shards as durable that the ledger does not know of; returns all of sound shards."""
    found: set[int] = set()
    known = {index for episodes in ledger.census.shards().values() for index in episodes}
    for name, shard in sound.items():
        for row, episode in enumerate(shard.episodes):
            key = shard.episode_key(row)
            if (key.seed, key.split) != (spec.seed, spec.split):
                continue
            found.add(key.index)
            if key.index not in known:
                written = Written(
                    recorder=recorder_of_shard(name),
                    attempt=int(episode["attempt"]),
                    shard=name,
                    samples=int(episode["sample_count"]),
                    policy=shard.ending(row).policy,
                )
                ledger.adopt(key.index, written)
    return found


def _give_back(ledger: Ledger, folder: RunFolder, sound: Mapping[str, ShardIndex], *, recorded_here: bool) -> set[int]:
    """Have episodes recorded again that are in no sound shard; what open shards hold, their recorders tell."""
    lost: set[int] = set()
    for name, episodes in ledger.census.shards().items():
        if not recorded_here and not any(folder.shard(name).parent.glob(f"shard-{recorder_of_shard(name)}-*")):
            continue
        missing = _missing(episodes, sound.get(name))
        part = folder.shard(name + PART_SUFFIX)
        if missing and part.exists():
            ledger.doubt(name)
            lost |= set(missing) - set(_indices(part))
        elif missing:
            ledger.miss(missing)
            lost |= set(missing)
    return lost


def _entrust_open_shards(ledger: Ledger, folder: RunFolder, spec: RunSpec) -> None:
    """Have recorders tell what their open shards hold, also of what the ledger has lost."""
    recorders = set(config_of(spec).coordinator.recorders) - ledger.retired()
    for part in _shards(folder, f"{SHARDS}{PART_SUFFIX}"):
        recorder = recorder_of_shard(part.name)
        if recorder not in recorders:
            continue
        for key in episode_keys(part):
            if (key.seed, key.split) == (spec.seed, spec.split):
                ledger.entrust(key.index, recorder)


def _missing(episodes: Mapping[int, int], shard: ShardIndex | None) -> list[int]:
    """Indices that a shard should have with so many samples, and has not."""
    found = {} if shard is None else {int(row["index"]): int(row["sample_count"]) for row in shard.episodes}
    return [index for index, samples in episodes.items() if found.get(index) != samples]
