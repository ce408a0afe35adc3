"""`readygo benchmark`: drive a suite, verify and pack results, write the table of drivers, check published weights."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from rich.progress import BarColumn, MofNCompleteColumn, TextColumn, TimeRemainingColumn
from rich.table import Table
from tyro.conf import Positional

from readygo.apps.benchmark.drive import SuiteDrive, drive_suite
from readygo.apps.benchmark.films import film_leaderboard
from readygo.apps.benchmark.leaderboard import leaderboard_html, leaderboard_markdown, read_leaderboard
from readygo.apps.benchmark.submission import pack_results
from readygo.apps.benchmark.verify import Verification, verify_folder
from readygo.apps.commands.evaluate import episode_progress
from readygo.apps.commands.progress import SteadyProgress
from readygo.apps.terminal import PlainConsole
from readygo.common.errors import ConfigError, PolicyError, RunError
from readygo.common.files import write_whole
from readygo.runs.benchmark.folder import CELLS_FOLDER, BenchmarkManifest, read_manifest
from readygo.runs.benchmark.suite import SUITES, OpenSuite, open_suite
from readygo.runs.benchmark.weights import DOWNLOAD, PARAMETERS, check_weights
from readygo.runs.methods import CHECKPOINTS, NETWORKS, network_of
from readygo.runs.trained import check_out
from readygo.services.evaluator import short_name

PAGE_FILE, MARKDOWN_FILE = "leaderboard.html", "leaderboard.md"
MISMATCHES_SHOWN = 20
_WEIGHTS_NOTE = (
    f"The authors offer {', '.join(NETWORKS.values())} at {DOWNLOAD}.\n"
    "readygo pins no hashes of them: their files could not be fetched where it was made. Compare the hashes below with "
    "those that others print."
)


@dataclass(frozen=True, kw_only=True)
class BenchmarkRunOptions:
    """Drive drivers through all cells of a suite; after an interruption the same command resumes.

    A suite is data: scenes by hash, robot, people, and cells of episodes that are the same for every driver.
    """

    suite: Positional[str]
    """Name of a suite, such as pedestrian-nav/1, or the path of your own, a .toml file."""
    drivers: Positional[tuple[str, ...]] = ()
    """As --methods of `readygo evaluate`: expert, social-force and so on, a policy by the name of its folder in
    `checkpoints`, or your class as folder/file.py:MyDriver. Policies of several training seeds are folders in one
    folder, mine/0 and mine/1: they become one row of the table. gnm/zero-shot and gnm/fine-tuned are two rows."""
    out: Path
    """Folder for the records, their hashes and scores; further drivers may join those that are there."""
    episodes: int | None = None
    """Episodes per cell, to try something; by default all of the suite's. The result is marked as incomplete."""
    workers: int = 0
    """Processes that drive, one per core; 0 drives in this process. The results are the same."""
    checkpoints: Path = CHECKPOINTS
    """Folder of policies and of the weights of networks."""


def benchmark_run(options: BenchmarkRunOptions) -> None:
    """Drive drivers through all cells of a suite; after an interruption the same command resumes."""
    check_out(options.out)
    suite = open_suite(options.suite)
    drive = SuiteDrive(
        suite=suite,
        drivers=options.drivers,
        folder=options.out,
        checkpoints=options.checkpoints,
        episodes=options.episodes,
        workers=options.workers,
    )
    with _kept(options.out), episode_progress(PlainConsole(stderr=True), drive.total, quiet=False) as (show, _):
        manifest = drive_suite(drive, report=show)
    console = PlainConsole()
    console.print(_success_table(suite, manifest))
    if not manifest.complete:
        wanted = suite.suite.episodes
        console.print(f"Incomplete: {manifest.episodes} of {wanted} episodes of a cell; leave --episodes out for all.")
    console.print(f"Check it: readygo benchmark verify {options.out}", markup=False, soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class BenchmarkVerifyOptions:
    """Check results: no file was edited or left out, the scores follow, and drawn records drive again to the same."""

    folder: Positional[Path]
    """Folder of `readygo benchmark run`, or an unpacked submission."""
    suite: str = ""
    """Path of the suite's .toml file, if it does not come with readygo."""
    share: float = 0.05
    """Share of each cell's records that is driven again, at least one; 0 checks the files alone."""
    seed: int = 0
    """Seed of the draw: choose one that who drove did not know."""
    checkpoints: Path = CHECKPOINTS
    """Folder of the policies and weights of its drivers."""


def benchmark_verify(options: BenchmarkVerifyOptions) -> None:
    """Check results: no file was edited or left out, the scores follow, and drawn records drive again to the same."""
    verification = Verification(
        suite=_suite_of(options.folder, options.suite),
        folder=options.folder,
        checkpoints=options.checkpoints,
        share=options.share,
        seed=options.seed,
    )
    with SteadyProgress(
        TextColumn("driven again"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn()
    ) as progress:
        task = progress.add_task("", total=None)
        lines, driven = verify_folder(
            verification, lambda done, total: progress.update(task, completed=done, total=total)
        )
    console = PlainConsole(soft_wrap=True)
    for line in lines[:MISMATCHES_SHOWN]:
        console.print(line, markup=False)
    if lines:
        raise RunError(f"{options.folder} does not verify: {len(lines)} mismatches, {driven} records driven again.")
    console.print(f"{options.folder} verifies: {driven} records driven again are the same.", markup=False)


@dataclass(frozen=True, kw_only=True)
class BenchmarkSubmitOptions:
    """Pack complete results into a file that others can verify; policies and weights are sent beside it."""

    folder: Positional[Path]
    """Folder of `readygo benchmark run`."""
    out: Path
    """ZIP file to write."""
    suite: str = ""
    """Path of the suite's .toml file, if it does not come with readygo."""


def benchmark_submit(options: BenchmarkSubmitOptions) -> None:
    """Pack complete results into a file that others can verify; policies and weights are sent beside it."""
    count = pack_results(options.folder, _suite_of(options.folder, options.suite), options.out)
    PlainConsole().print(f"{options.out} has {count} files.", markup=False, soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class BenchmarkTableOptions:
    """Write the table of the drivers of one or more results of a suite, as a page and as Markdown."""

    folders: Positional[tuple[Path, ...]]
    """Folders of `readygo benchmark run`, or unpacked submissions."""
    out: Path
    """Folder for leaderboard.html, leaderboard.md and films."""
    suite: str = ""
    """Path of the suite's .toml file, if it does not come with readygo."""
    reference: str = ""
    """Driver that the others are compared with, episode by episode; by default the expert, else the first one."""
    video: bool = False
    """Film the median and the worst episode of each row, in the cell that the paper's figures compare with."""


def benchmark_table(options: BenchmarkTableOptions) -> None:
    """Write the table of the drivers of one or more results of a suite, as a page and as Markdown."""
    if not options.folders:
        raise RunError("Name a folder: readygo benchmark table FOLDER --out PAGE.")
    board = read_leaderboard(options.folders, _suite_of(options.folders[0], options.suite), options.reference)
    films = film_leaderboard(board, options.out) if options.video else []
    write_whole(options.out / PAGE_FILE, leaderboard_html(board, films))
    write_whole(options.out / MARKDOWN_FILE, leaderboard_markdown(board))
    PlainConsole().print(f"Look at it: {options.out / PAGE_FILE}", markup=False, soft_wrap=True)


@dataclass(frozen=True, kw_only=True)
class BenchmarkWeightsOptions:
    """Say which files the published networks GNM, ViNT and NoMaD need, and check those of a folder by loading them."""

    checkpoints: Path = CHECKPOINTS
    """Folder of the files."""


def benchmark_weights(options: BenchmarkWeightsOptions) -> None:
    """Say which files the published networks GNM, ViNT and NoMaD need, and check those of a folder by loading them."""
    console = PlainConsole(soft_wrap=True)
    found = check_weights(options.checkpoints)
    console.print(_WEIGHTS_NOTE, markup=False)
    for weights in found:
        said = weights.defect or f"{weights.path} is {weights.driver}, SHA-256 {weights.sha256}."
        count = PARAMETERS[network_of(weights.driver)]
        console.print(f"{weights.driver}, {count:,} numbers: {said}", markup=False)
    if missing := [weights.driver for weights in found if weights.defect]:
        raise PolicyError(f"{', '.join(missing)} cannot drive with what is in {options.checkpoints}.")


def _suite_of(folder: Path, suite: str) -> OpenSuite:
    """The suite of a folder's results: the named file, else the one of that name that comes with readygo."""
    if suite:
        return open_suite(suite)
    name = read_manifest(folder).suite
    if name not in SUITES:
        raise ConfigError(
            f"{folder} is of the suite {name!r}, which does not come with readygo: name its file --suite."
        )
    return open_suite(name)


def _success_table(suite: OpenSuite, manifest: BenchmarkManifest) -> Table:
    """Success rates in percent by cell and driver."""
    table = Table(title=f"{manifest.suite}: success in percent")
    table.add_column("cell", no_wrap=True)
    for name in manifest.drivers:
        table.add_column(short_name(name), justify="right")
    for cell in suite.suite.cells:
        scores = manifest.scores[cell]
        rates = [scores[name]["success"] if name in scores else None for name in manifest.drivers]
        table.add_row(cell, *(f"{100 * rate['mean']:.0f}" if rate else "" for rate in rates))
    return table


@contextmanager
def _kept(folder: Path) -> Iterator[None]:
    """At Ctrl-C, say that the records are kept, if there are any."""
    try:
        yield
    except KeyboardInterrupt:
        if not (folder / CELLS_FOLDER).exists():
            raise
        raise KeyboardInterrupt(f"the episodes that ended are kept in {folder}; the same command resumes.") from None
