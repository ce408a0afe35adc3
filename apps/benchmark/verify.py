"""Verifies a folder of results: nothing was edited or left out, and a drawn share drives again to the same records."""

import itertools
import math
from collections.abc import Callable, Collection, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from readygo.apps.benchmark.drive import cell_evaluator
from readygo.common.arrays import Float64Array
from readygo.common.config import section_differences
from readygo.common.errors import RunError
from readygo.runs.benchmark.folder import (
    MANIFEST_FILE,
    BenchmarkManifest,
    cell_folder,
    check_suite,
    defects,
    read_cells,
    read_manifest,
    stated_inputs,
)
from readygo.runs.benchmark.inputs import inputs_of
from readygo.runs.benchmark.suite import OpenSuite
from readygo.runs.evaluation import evaluation_settings
from readygo.runs.method_files import method_hashes
from readygo.services.evaluator import (
    EpisodeRecord,
    MatchedEpisode,
    RecordKey,
    drive,
    is_of,
    read_results,
)

Show = Callable[[int, int], None]
"""Told how many of how many drawn records are driven again."""


@dataclass(frozen=True, kw_only=True)
class Verification:
    """How a folder of results is verified."""

    suite: OpenSuite
    folder: Path
    checkpoints: Path
    """Folder of the weights and policies of its drivers."""
    share: float = 0.05
    """Share of each cell's records that is driven again, at least one; 0 drives none."""
    seed: int = 0
    """Seed of the draw."""

    def __post_init__(self) -> None:
        if not 0 <= self.share <= 1:
            raise RunError(f"--share must be 0..1, got {self.share:g}.")
        if self.seed < 0:
            raise RunError(f"--seed must be at least 0, got {self.seed}.")


def verify_folder(verification: Verification, show: Show = lambda done, total: None) -> tuple[list[str], int]:
    """Look for what does not hold in a folder.

    Args:
        verification: What to verify, and how.
        show: Told of every record that was driven again.

    Returns:
        A line for every mismatch, and how many records were driven again.

    Raises:
        ReadygoError: If the folder is of another suite or cannot be read, or a scene, an avatar or a driver is missing.
    """
    suite, folder = verification.suite, verification.folder
    manifest = read_manifest(folder)
    check_suite(manifest, suite, folder)
    lines = defects(folder, suite, manifest)
    if verification.share:
        _check_drivers(manifest, verification.checkpoints)
        lines += _wrong_inputs(manifest, verification)
    cells = read_cells(folder, suite, manifest.drivers)
    drawn = {cell: _draw_records(verification, k, records) for k, (cell, records) in enumerate(cells.items())}
    total, done = sum(map(len, drawn.values())), itertools.count(1)
    for cell in cells:
        for scene in suite.suite.scenes:
            found = _mismatches(verification, manifest, cell, scene, drawn[cell], lambda: show(next(done), total))
            lines += [f"{cell}, {scene}: {line}" for line in found]
    return lines, total


def _check_drivers(manifest: BenchmarkManifest, checkpoints: Path) -> None:
    """Raise RunError unless the files of the drivers are here, the same to the byte."""
    here = method_hashes(tuple(manifest.drivers), checkpoints)
    for name, driver in manifest.drivers.items():
        if driver.sha256 != here.get(name, ""):
            words = "is another one here" if name in here else f"is not in {checkpoints}"
            raise RunError(
                f"The driver {name} {words} (SHA-256 {driver.sha256[:12]}...): get it from who drove it, and name its "
                "folder with --checkpoints."
            )


def _wrong_inputs(manifest: BenchmarkManifest, verification: Verification) -> list[str]:
    """A line for everything that a driver is given, or has learned from, other than the manifest says."""
    scenes = verification.suite.scene_hashes
    return [
        f"{MANIFEST_FILE}: {field} of {name} is {said!r} there, found {found!r}"
        for name, driver in manifest.drivers.items()
        for field, found, said in section_differences(
            stated_inputs(manifest, name, inputs_of(name, verification.checkpoints, scenes)), driver.inputs
        )
    ]


def _draw_records(verification: Verification, number: int, records: Sequence[EpisodeRecord]) -> set[RecordKey]:
    """The records of a cell that are driven again."""
    if not verification.share or not records:
        return set()
    rng = np.random.Generator(np.random.Philox(np.random.SeedSequence((verification.seed, number))))
    count = max(1, math.ceil(verification.share * len(records)))
    return {records[k].key for k in rng.permutation(len(records))[:count].tolist()}


def _mismatches(
    verification: Verification,
    manifest: BenchmarkManifest,
    cell: str,
    scene: str,
    drawn: Collection[RecordKey],
    driven: Callable[[], None],
) -> Iterator[str]:
    """What does not hold in a cell and scene: settings, episodes, records that drive again to others.

    `driven` is called after each of those.
    """
    names = tuple(manifest.drivers)
    world = verification.suite.world(cell, scene)
    request = verification.suite.request(cell, scene, names)
    hashes = {name: driver.sha256 for name, driver in manifest.drivers.items() if driver.sha256}
    settings = evaluation_settings(world, request, policy="", camera="policy", methods=hashes)
    folder = cell_folder(verification.folder, cell, scene)
    if not is_of(folder, settings):
        yield "the settings are not those of the suite"
        return
    used = [name for name in names if any(method == name for _, method, _ in drawn)]
    evaluator = cell_evaluator(world, request, used, verification.checkpoints)
    episodes, _ = evaluator.source().draw(
        seed=request.seed, split=request.split, count=request.episodes, tasks=request.tasks
    )
    begun = episodes[: verification.suite.episodes_of(scene, manifest.episodes)]
    with read_results(folder) as results:
        for name in names:
            if missing := sum(_key(episode, name) not in results.records for episode in begun):
                yield f"{missing} episodes of {name} are missing"
            known = {_key(episode, name) for episode in episodes}
            if foreign := sum(key not in known for key, record in results.records.items() if record.method == name):
                yield f"{foreign} records of {name} are of no episode of the suite"
        hold_steps, kept = request.hold_steps(world.config.robot.clock), results.actions(drawn)
        for name in used:
            chosen = [episode for episode in episodes if _key(episode, name) in drawn]
            for record, trajectory in drive(evaluator, name, evaluator.driver(name, hold_steps), chosen):
                driven()
                old = results.records[record.key]
                if line := _difference(old, record, kept.get(record.key), trajectory.actions):
                    yield f"{name} in {record.episode.episode_id} {line}"


def _difference(
    kept: EpisodeRecord, again: EpisodeRecord, kept_actions: Float64Array | None, actions: Float64Array
) -> str:
    """How a record differs from the one that was driven again; empty if it does not."""
    theirs, ours = kept.to_mapping(), again.to_mapping()
    for key in {**theirs, **ours}:
        if theirs.get(key) != ours.get(key):
            return f"has {key} {theirs.get(key)!r}, driven again {ours.get(key)!r}"
    same = kept_actions is not None and np.array_equal(kept_actions, actions)
    return "" if same else "has other commands than when it is driven again"


def _key(episode: MatchedEpisode, driver: str) -> RecordKey:
    return episode.task, driver, episode.scenario.episode
