"""Reconciliation of a run's ledger and its shards after either was lost or damaged.

The shards are authoritative. A lost ledger is rebuilt from them; a durable episode that is in no intact shard is
recorded again. A damaged shard becomes an open one, of which its recorder saves the complete episodes, as after a
crash. If an episode is in several shards, the first one by name retains its copy, and the others are rewritten without
theirs.
"""

import contextlib
import json
import logging
import zlib
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from readygo.common.dataset.committed import episode_indices, episode_keys
from readygo.common.dataset.index import DATA_END_SIZE, ShardIndex, index_path, load_index, map_file, tail_offset
from readygo.common.dataset.records import RECORD_HEADER
from readygo.common.dataset.writer import PART_SUFFIX, is_shard_of, recorder_of_shard, shard_name
from readygo.common.documents import read_json
from readygo.common.errors import DatasetError, DiskError, RunError
from readygo.common.files import write_whole
from readygo.common.messages import EpisodeKey, RunSpec, Stage
from readygo.runs.config import config_of
from readygo.runs.folder import RunFolder
from readygo.runs.recorders import keep_retired
from readygo.services.coordinator import Ledger, Written
from readygo.services.recorder import drop_episodes, next_number

log = logging.getLogger(__name__)

SHARDS = "shard-*.mcap"


@dataclass(kw_only=True)
class Findings:
    """Result of the consistency check."""

    rebuilt: bool = False
    """True if the ledger was rebuilt."""
    damaged: dict[Path, str] = field(default_factory=dict)
    """Kind of damage by damaged shard."""
    doubles: dict[Path, int] = field(default_factory=dict)
    """Number of duplicate episodes by the shard from which they were removed."""
    lost: list[int] = field(default_factory=list)
    """Durable episodes that are in no intact shard: they are recorded again unless they can be saved."""

    @property
    def lines(self) -> list[str]:
        """The findings in words."""
        lines = ["The run's ledger was lost or damaged: it is rebuilt from the shards."] if self.rebuilt else []
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
    """Reconcile a run's ledger and shards; call it with the folder's lock, before the run resumes.

    Args:
        folder: Folder of a run, with its spec.
        every_byte: True also reads shards again that were intact before and have not changed since.
        recorded_here: False if recorders have disks on other machines. Then the ledger is trusted for episodes without
            a shard here, it is not rebuilt without their shards, and duplicate episodes stay: a recorder may be
            working on them.

    Raises:
        RunError: If the folder cannot be written, a lost ledger cannot be rebuilt, or `recorded_here` does not match
            the folder: shards are on other machines, and the ledger that knows of them is sound.
    """
    if not recorded_here and not folder.ledger.exists() and folder.blobs.exists():
        raise _not_made_anew(folder, f"The run's ledger {folder.ledger} is gone.")
    if recorded_here and folder.elsewhere.exists() and (folder.has_data or not folder.ledger.exists()):
        _check_gathered(folder)
    if not folder.has_data:
        return Findings()
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
        if findings.rebuilt:
            # From the shards that were gathered here: the run is one of this machine now.
            folder.elsewhere.unlink(missing_ok=True)
        keep_retired(folder, ledger)
        lost = _give_back(ledger, folder, named, recorded_here=recorded_here)
        findings.lost = sorted(lost - _adopt_episodes(ledger, named, spec))
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
    """Check that every durable episode of a run's ledger is in a readable shard.

    Raises:
        RunError: If an episode is not.
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
            f"`readygo recover {folder.path}`, to record them again."
        )


class Witness:
    """Checks whether an episode is in a recorder's shards; each part of a shard is read only once."""

    def __init__(self, folder: RunFolder) -> None:
        self._folder = folder
        self._read: dict[str, tuple[int, set[int]]] = {}

    def holds_episode(self, recorder: str, shard: str, index: int) -> bool:
        """True if a recorder's finished or open shard contains the beginning of an episode with this index.

        False for a name that none of its shards can have: reports of recorders are not trusted.
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
            # The file was replaced since it was read.
            end, found = 0, set()
        for index, after in episode_indices(shard, end):
            end = after
            found.add(index)
        self._read[name] = end, found
        return found


def _shards(folder: RunFolder, pattern: str) -> list[Path]:
    return sorted(shard for place in folder.places for shard in place.glob(pattern))


def _indices(shard: Path) -> list[int]:
    """Indices of the episodes in a finished or open shard; empty for a file that is not a shard."""
    return [index for index, _ in episode_indices(shard)] if shard.is_file() and shard.suffix != ".index" else []


def _sound_shards(folder: RunFolder, findings: Findings, *, every_byte: bool = False) -> dict[Path, ShardIndex]:
    """The intact finished shards; damaged ones are added to the findings.

    Shards whose bytes have matched their checksum are not read again while size and modification time are unchanged.
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
    """Shards by name; of two with the same name, the one in the folder of its recorder."""
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
    with map_file(shard) as view:
        end = tail_offset(view, shard)
        stored = int.from_bytes(view[end + RECORD_HEADER.size : end + DATA_END_SIZE], "little")
        if zlib.crc32(view[:end]) != stored:
            raise DatasetError(f"Shard {shard} does not match its CRC-32")


def _reopen(shard: Path) -> None:
    """Turn a damaged shard into an open one, of which its recorder saves the complete episodes at its start."""
    part = shard.with_name(shard.name + PART_SUFFIX)
    if part.exists():
        # Left by a crash: each of the two may hold episodes that the other one lacks.
        recorder = recorder_of_shard(shard.name)
        part = shard.with_name(shard_name(recorder, next_number(shard.parent, recorder)) + PART_SUFFIX)
    index_path(shard).unlink(missing_ok=True)
    shard.rename(part)


def _settle_doubles(folder: RunFolder, sound: dict[Path, ShardIndex], spec: RunSpec, findings: Findings) -> None:
    """Retain one copy of every episode; updates `sound` to the remaining shards."""
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
    """True for a shard in the folder that its recorder writes to."""
    return shard == folder.shard(shard.name)


def _without(shard: Path, rows: Collection[int], spec: RunSpec) -> bool:
    """Remove episodes from a shard; False if none is left."""
    # Imported here: it loads the modules of all stages.
    from readygo.runs.world import World

    try:
        return drop_episodes(shard, rows, World(spec).stage())
    except OSError as error:
        raise RunError(
            f"{shard} cannot be written without what other shards hold as well: {error.strerror or error}."
        ) from error


def _check_gathered(folder: RunFolder) -> None:
    """Check that the run of recorders on other machines has lost its ledger, and that shards lie here to rebuild it.

    Raises:
        RunError: If not.
    """
    why = _ledger_loss(folder)
    if not why:
        raise RunError(
            f"Shards of {folder.path} are on other machines: `readygo coordinator {folder.path}` resumes the run, "
            "after `readygo requeue` if one of its recorders has lost its disk."
        )
    if not any(folder.path.glob(f"{SHARDS}*")):
        raise _not_made_anew(folder, why)


def _ledger_loss(folder: RunFolder) -> str:
    """Why the ledger must be rebuilt; empty if it is sound. A full disk does not count as damage."""
    if not folder.ledger.exists():
        return f"The run's ledger {folder.ledger} is gone."
    try:
        with contextlib.closing(Ledger(folder.ledger, folder.load()[0].stages)) as ledger:
            ledger.check()
            return f"The run's ledger {folder.ledger} was lost and is only partly rebuilt." * ledger.unfinished
    except DiskError:
        raise
    except RunError as error:
        return str(error)


def _not_made_anew(folder: RunFolder, why: str) -> RunError:
    return RunError(
        f"{why} Its recorders are on other machines: gather their shards in {folder.path}, and run "
        f"`readygo recover {folder.path}`, which rebuilds it from them."
    )


def _open_ledger(folder: RunFolder, stages: tuple[Stage, ...], findings: Findings, *, recorded_here: bool) -> Ledger:
    """Open the run's ledger; a new one if it is damaged, or missing although there are shards.

    An unfinished rebuild of an earlier process is resumed. A full disk does not count as damage.
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
        raise _not_made_anew(folder, f"The run's ledger {folder.ledger} was lost and is only partly rebuilt.")
    if findings.rebuilt:
        ledger.begin_rebuild()
    return ledger


def _adopt_episodes(ledger: Ledger, sound: Mapping[str, ShardIndex], spec: RunSpec) -> set[int]:
    """Mark unknown episodes of intact shards as durable in the ledger; returns all episodes of intact shards."""
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
    """Requeue episodes that are in no intact shard; recorders report those in open shards."""
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
    """Let recorders report the episodes of their open shards, also those that the ledger has lost."""
    recorders = set(config_of(spec).coordinator.recorders) - ledger.retired_recorders()
    for part in _shards(folder, f"{SHARDS}{PART_SUFFIX}"):
        recorder = recorder_of_shard(part.name)
        if recorder not in recorders:
            continue
        for key in episode_keys(part):
            if (key.seed, key.split) == (spec.seed, spec.split):
                ledger.entrust(key.index, recorder)


def _missing(episodes: Mapping[int, int], shard: ShardIndex | None) -> list[int]:
    """Indices of episodes that a shard lacks, or has with a different number of samples."""
    found = {} if shard is None else {int(row["index"]): int(row["sample_count"]) for row in shard.episodes}
    return [index for index, samples in episodes.items() if found.get(index) != samples]
