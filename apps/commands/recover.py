"""`readygo recover`: repairs a data folder with lost or damaged files."""

from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from readygo.apps.commands.generate import progress_bar
from readygo.apps.fleet.run import record
from readygo.apps.terminal import PlainConsole
from readygo.runs.folder import RunFolder
from readygo.runs.recovery import recover as recover_run


@dataclass(frozen=True, kw_only=True)
class RecoverOptions:
    """Repair a data folder: read all of it, keep the intact episodes, and record the others again.

    A lost or damaged ledger is rebuilt from the shards. `readygo generate` does the same when it resumes a run, but
    does not read unchanged shards again.
    """

    data: Positional[Path]
    """Data folder of a run."""
    workers: int = 1
    """Renderer or driver processes, as for `readygo generate`; 0 does everything in this process."""


def recover(options: RecoverOptions) -> None:
    """Repair a data folder: read all of it, keep the intact episodes, and record the others again."""
    folder = RunFolder(options.data)
    spec, wanted = folder.load()
    with folder.lock():
        findings = recover_run(folder, every_byte=True)
    console = PlainConsole(stderr=True, soft_wrap=True)
    if not findings.lines:
        console.print("Nothing is lost or damaged.", markup=False)
    with progress_bar() as show:
        summary = record(spec, options.data, episodes=wanted, workers=options.workers, show=show)
    console.print(
        f"{options.data} holds {summary['episodes']:,} episodes, {summary['samples']:,} samples.", markup=False
    )
