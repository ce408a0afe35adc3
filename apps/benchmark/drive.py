"""Drives a suite: every cell in every scene is an evaluation, with its machinery and its records."""

from collections.abc import Mapping, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path

from readygo.apps.fleet.evaluation import EvaluationFleet, by_fleet, fleet_spec, make_plan
from readygo.common.dataset.provenance import Provenance
from readygo.common.errors import RunError
from readygo.runs.benchmark.folder import (
    MANIFEST_FILE,
    BenchmarkedDriver,
    BenchmarkManifest,
    cell_folder,
    check_suite,
    join_origins,
    read_manifest,
    write_manifest,
)
from readygo.runs.benchmark.inputs import check_names, inputs_of
from readygo.runs.benchmark.suite import OpenSuite
from readygo.runs.evaluation import evaluation_settings, make_evaluator
from readygo.runs.method_files import method_hashes
from readygo.runs.methods import named_methods, needs_renderer
from readygo.runs.world import World
from readygo.services.evaluator import (
    EvaluateRequest,
    Evaluator,
    EvaluatorConfig,
    Report,
    handle_evaluate,
    open_results,
)

LOCKSTEP = EvaluatorConfig().lockstep


@dataclass(frozen=True, kw_only=True)
class SuiteDrive:
    """Which drivers drive through a suite, and how."""

    suite: OpenSuite
    drivers: tuple[str, ...]
    folder: Path
    """Folder of the results."""
    checkpoints: Path
    """Folder of weights and policies."""
    episodes: int | None = None
    """Episodes of a cell; None for all of the suite's."""
    workers: int = 0
    """Processes that drive; 0 drives in this process."""

    def __post_init__(self) -> None:
        count = len(self.suite.suite.scenes)
        if not self.drivers:
            raise RunError("Name a driver: readygo benchmark run SUITE DRIVER --out FOLDER.")
        if self.episodes is not None and not count <= self.episodes <= self.suite.suite.episodes:
            raise RunError(
                f"--episodes must be {count}..{self.suite.suite.episodes} for this suite, got {self.episodes}."
            )

    @property
    def total(self) -> int:
        """Episodes of all cells and drivers."""
        of_cell = self.suite.suite.episodes if self.episodes is None else self.episodes
        return of_cell * len(self.suite.suite.cells) * len(self.drivers)


def drive_suite(drive: SuiteDrive, *, report: Report) -> BenchmarkManifest:
    """Drive the missing episodes of all cells, and write what the folder then holds.

    Args:
        drive: What to drive; an interrupted one resumes.
        report: Told about every episode that ends, and of those that had ended before.

    Raises:
        ReadygoError: If a scene, an avatar or a driver is missing or different, the folder has records of another
            version or numeric class, or cannot be written.
    """
    check_names(drive.drivers)
    made_by = _made_by(drive.suite)
    if (drive.folder / MANIFEST_FILE).exists():
        earlier = read_manifest(drive.folder)
        check_suite(earlier, drive.suite, drive.folder)
        made_by = _joined(drive.folder, earlier.made_by, made_by)
    hashes = method_hashes(drive.drivers, drive.checkpoints)
    scenes = drive.suite.scene_hashes
    drivers = {
        name: BenchmarkedDriver(sha256=hashes.get(name, ""), inputs=inputs_of(name, drive.checkpoints, scenes))
        for name in drive.drivers
    }
    for cell, scene in drive.suite.places:
        _drive_cell(drive, drive.suite.world(cell, scene), cell, scene, hashes, report)
    return write_manifest(drive.folder, drive.suite, drivers, made_by)


def _made_by(suite: OpenSuite) -> dict[str, str]:
    """What this process would make records with."""
    origin = Provenance.of_run(suite.world(*suite.places[0]).spec)
    return {"readygo": origin.readygo_version, "commit": origin.commit, "numeric_class": origin.numeric_class}


def _joined(folder: Path, earlier: Mapping[str, str], now: Mapping[str, str]) -> dict[str, str]:
    """What the records of a folder are made with if this process adds some; commits are listed.

    Raises:
        RunError: If these would not agree to the bit.
    """
    for name, what in (("readygo", "version of readygo"), ("numeric_class", "numeric class")):
        if earlier.get(name) != now[name]:
            raise RunError(
                f"{folder} has records of the {what} {earlier.get(name)}, this is {now[name]}: records of both do not "
                "agree to the bit. Give another --out; `readygo benchmark table` takes several folders."
            )
    return join_origins([earlier, now])


def cell_evaluator(
    world: World, request: EvaluateRequest, drivers: Sequence[str], checkpoints: Path, *, renders: bool = True
) -> Evaluator:
    """The evaluator of a cell in a scene.

    Args:
        world: World of the cell.
        request: Episodes of the cell.
        drivers: Drivers that drive in it.
        checkpoints: Folder of weights and policies.
        renders: False makes no renderer, where other processes look.
    """
    hold_steps = request.hold_steps(world.config.robot.clock)
    return make_evaluator(
        world,
        renderer=world.renderer() if renders and needs_renderer(drivers, checkpoints) else None,
        methods=named_methods(world, drivers, checkpoints, hold_steps),
    )


def _drive_cell(drive: SuiteDrive, world: World, cell: str, scene: str, hashes: dict[str, str], report: Report) -> None:
    request = drive.suite.request(cell, scene, drive.drivers, drive.episodes)
    settings = evaluation_settings(world, request, policy="", camera="policy", methods=hashes)
    evaluator = cell_evaluator(world, request, drive.drivers, drive.checkpoints, renders=not drive.workers)
    evaluator.check_drivers(request)
    with ExitStack() as files:
        results = files.enter_context(open_results(cell_folder(drive.folder, cell, scene), settings))
        fleet = None
        if drive.workers:
            fleet = EvaluationFleet(
                spec=fleet_spec(world, None),
                plan=make_plan(
                    request, camera="policy", lockstep=LOCKSTEP, checkpoints=drive.checkpoints, method_hashes=hashes
                ),
                request=request,
                results=results,
                workers=drive.workers,
                report=report,
            )
        handle_evaluate(
            evaluator,
            request,
            report=report,
            results=results,
            elsewhere=by_fleet(fleet) if fleet else None,
        )
