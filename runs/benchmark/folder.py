"""The folder of a benchmark's results: records of every cell and scene, and a manifest that says how they came.

benchmark.json                      suite, drivers, versions, scores, and the SHA-256 of every file of records
suite.toml                          the suite as it was driven
cells/CELL/SCENE/episodes.jsonl     results of an evaluation, see `services/evaluator/README.md`
"""

import dataclasses
import hashlib
import json
import math
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from readygo.common.config import section_from_mapping, section_to_mapping
from readygo.common.documents import read_json, write_json
from readygo.common.errors import ConfigError, RunError, cause
from readygo.common.files import read_regular, write_whole
from readygo.runs.benchmark.inputs import DriverInputs, unstated
from readygo.runs.benchmark.suite import OpenSuite
from readygo.services.evaluator import EpisodeRecord, read_results, score_mapping, scores_of

RESULTS_FORMAT, FIRST_FORMAT = "readygo-benchmark/2", "readygo-benchmark/1"
"""The first one does not state what all kinds of drivers have learned from, see `unstated`."""
MANIFEST_FILE, SUITE_FILE, CELLS_FOLDER = "benchmark.json", "suite.toml", "cells"
RECORD_FILES = ("episodes.jsonl", "trajectories.jsonl", "settings.json")
"""Files of an evaluation that a result consists of."""
_SCORES_RTOL = 1e-9


@dataclass(frozen=True, kw_only=True)
class BenchmarkedDriver:
    """One driver of a benchmark."""

    sha256: str = ""
    """SHA-256 of its policy, weights or source; empty for the drivers of readygo."""
    inputs: DriverInputs = field(default_factory=DriverInputs)


@dataclass(frozen=True, kw_only=True)
class BenchmarkManifest:
    """How the records of a folder came, and what follows from them."""

    format: str
    suite: str
    """Name of the suite."""
    suite_sha256: str
    episodes: int
    """Episodes of a cell that every driver drove."""
    complete: bool
    """True if these are all episodes of the suite."""
    drivers: Mapping[str, BenchmarkedDriver]
    made_by: Mapping[str, str]
    """Version and commit of readygo, and the numeric class of the machine."""
    files: Mapping[str, str]
    """SHA-256 of each file of records, by its path in the folder."""
    scores: Mapping[str, Any]
    """Measures with intervals: cell -> driver -> measure."""


def cell_folder(folder: Path, cell: str, scene: str) -> Path:
    """The folder with the evaluation of a cell in a scene."""
    return folder / CELLS_FOLDER / cell / scene


def read_cells(folder: Path, suite: OpenSuite, drivers: Collection[str]) -> dict[str, list[EpisodeRecord]]:
    """Records by cell.

    Args:
        folder: Folder of results.
        suite: Their suite.
        drivers: Drivers whose records are read; others may have been interrupted.

    Raises:
        RunError: If a cell is missing, or its records cannot be read.
    """
    cells: dict[str, list[EpisodeRecord]] = {cell: [] for cell in suite.suite.cells}
    for cell, scene in suite.places:
        with read_results(cell_folder(folder, cell, scene)) as results:
            cells[cell] += [record for record in results.records.values() if record.method in drivers]
    return cells


def scores_by_cell(
    suite: OpenSuite, cells: Mapping[str, Sequence[EpisodeRecord]]
) -> dict[str, dict[str, dict[str, Any]]]:
    """All measures with their intervals, as plain values: cell -> driver -> measure."""
    return {
        cell: score_mapping(scores_of(records, time_limit_s=suite.config(cell).episode.time_limit_s)).get(
            suite.suite.cells[cell].task, {}
        )
        for cell, records in cells.items()
    }


def write_manifest(
    folder: Path, suite: OpenSuite, drivers: Mapping[str, BenchmarkedDriver], made_by: Mapping[str, str]
) -> BenchmarkManifest:
    """Write what the records of a folder are, beside them.

    Args:
        folder: Folder with the records.
        suite: The suite.
        drivers: Drivers of this run; those of earlier runs into the folder stay.
        made_by: Versions and numeric class.

    Raises:
        ReadygoError: If records cannot be read or the files cannot be written.
    """
    earlier = read_manifest(folder).drivers if (folder / MANIFEST_FILE).exists() else {}
    known = {**earlier, **drivers}
    cells = read_cells(folder, suite, known)
    episodes, complete = _progress(suite, cells, known)
    manifest = BenchmarkManifest(
        format=RESULTS_FORMAT,
        suite=suite.suite.name,
        suite_sha256=suite.sha256,
        episodes=episodes,
        complete=complete,
        drivers=known,
        made_by=made_by,
        files=dict(_digests(folder, suite)),
        scores=scores_by_cell(suite, cells),
    )
    write_whole(folder / SUITE_FILE, suite.text, raises=RunError)
    write_json(folder / MANIFEST_FILE, section_to_mapping(manifest), raises=RunError)
    return manifest


def read_manifest(folder: Path) -> BenchmarkManifest:
    """The manifest of a folder.

    Raises:
        RunError: If there is none, or it is broken.
    """
    path = folder / MANIFEST_FILE
    try:
        manifest = section_from_mapping(BenchmarkManifest, read_json(path))
    except FileNotFoundError as error:
        raise RunError(f"{folder} holds no finished benchmark: let `readygo benchmark run` end into it.") from error
    except (OSError, ValueError, ConfigError) as error:
        raise RunError(f"{path} cannot be read: {cause(error)}") from error
    if manifest.format not in (RESULTS_FORMAT, FIRST_FORMAT):
        raise RunError(f"{path} is of the format {manifest.format!r}, this version reads {RESULTS_FORMAT}.")
    if not manifest.drivers:
        raise RunError(f"{path} names no driver: let `readygo benchmark run` end into {folder}.")
    drivers = {
        name: dataclasses.replace(driver, inputs=stated_inputs(manifest, name, driver.inputs))
        for name, driver in manifest.drivers.items()
    }
    return dataclasses.replace(manifest, drivers=drivers)


def stated_inputs(manifest: BenchmarkManifest, driver: str, inputs: DriverInputs) -> DriverInputs:
    """What a manifest of its format states of a driver with these inputs."""
    return unstated(driver, inputs) if manifest.format == FIRST_FORMAT else inputs


def join_origins(origins: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """What several records were made with: all versions, commits and numeric classes, each once.

    Args:
        origins: As `BenchmarkManifest.made_by`.
    """
    found: dict[str, dict[str, None]] = {}
    for origin in origins:
        for name, value in origin.items():
            found.setdefault(name, {}).update(dict.fromkeys(filter(None, value.split(", "))))
    return {name: ", ".join(values) for name, values in found.items()}


def check_suite(manifest: BenchmarkManifest, suite: OpenSuite, folder: Path) -> None:
    """Raise RunError unless a folder is of this suite, to the byte."""
    if manifest.suite_sha256 != suite.sha256:
        raise RunError(
            f"{folder} is of the suite {manifest.suite} with the hash {manifest.suite_sha256[:12]}..., not of "
            f"{suite.suite.name} with {suite.sha256[:12]}...: use the version of readygo or the file that it names."
        )


def defects(folder: Path, suite: OpenSuite, manifest: BenchmarkManifest) -> list[str]:
    """What was changed in a folder since its manifest was written, a line each, without driving anything.

    Raises:
        RunError: If records cannot be read.
    """
    wanted = {**manifest.files, SUITE_FILE: suite.sha256}
    found = dict(_digests(folder, suite, SUITE_FILE))
    lines = [
        f"{name}: {'is missing' if name not in found else 'was edited'}"
        for name, sha256 in wanted.items()
        if found.get(name) != sha256
    ]
    lines += [f"{name}: is not in {MANIFEST_FILE}" for name in found if name not in wanted]
    cells = read_cells(folder, suite, manifest.drivers)
    if (manifest.episodes, manifest.complete) != _progress(suite, cells, manifest.drivers):
        lines.append(f"{MANIFEST_FILE}: the number of episodes does not follow from its records")
    scores = json.loads(json.dumps(scores_by_cell(suite, cells)))
    return lines + [
        f"{MANIFEST_FILE}: the scores of {cell} do not follow from its records"
        for cell in suite.suite.cells
        if not _same_scores(manifest.scores.get(cell), scores[cell])
    ]


def check_unchanged(folder: Path, suite: OpenSuite, manifest: BenchmarkManifest) -> None:
    """Raise RunError if a folder was changed since its manifest was written, or its records cannot be read."""
    if lines := defects(folder, suite, manifest):
        raise RunError(f"{folder} is not as it was driven: {lines[0]}{'' if len(lines) == 1 else ', and more'}.")


def _progress(
    suite: OpenSuite, cells: Mapping[str, Sequence[EpisodeRecord]], drivers: Collection[str]
) -> tuple[int, bool]:
    """Episodes of a cell that every driver drove, and whether these are all of the suite's."""
    counts = [sum(record.method == name for record in records) for records in cells.values() for name in drivers]
    return min(counts), set(counts) == {suite.suite.episodes}


def _same_scores(theirs: Any, ours: Any) -> bool:
    """True if scores are the same, up to the last digits, in which machines of two numeric classes may differ."""
    if isinstance(ours, dict):
        return (
            isinstance(theirs, dict)
            and theirs.keys() == ours.keys()
            and all(_same_scores(theirs[name], value) for name, value in ours.items())
        )
    if isinstance(ours, float) and isinstance(theirs, float):
        return math.isclose(theirs, ours, rel_tol=_SCORES_RTOL, abs_tol=_SCORES_RTOL)
    return bool(theirs == ours)


def _digests(folder: Path, suite: OpenSuite, *more: str) -> Iterator[tuple[str, str]]:
    """SHA-256 of each file of records, and of more files, by its path in the folder."""
    names = [(cell_folder(folder, *place) / name) for place in suite.places for name in RECORD_FILES]
    for path in (*names, *(folder / name for name in more)):
        if path.is_file():
            yield path.relative_to(folder).as_posix(), hashlib.sha256(read_regular(path)).hexdigest()
