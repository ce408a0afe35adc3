"""`readygo recover`: repairs a data folder with lost or damaged files."""

from pathlib import Path

from readygo.apps.commands.generate import progress_bar
from readygo.apps.fleet.run import record
from readygo.apps.run.folder import RunFolder
from readygo.apps.run.recovery import recover as recover_run
from readygo.apps.terminal import PlainConsole


def recover(data: Path, /, *, workers: int = 1) -> None:
    """Repair a data folder: read all of it, keep the intact episodes, and record the others again.

    A lost or damaged ledger is rebuilt from the shards. `readygo generate` does the same when it resumes a run, but
    does not read unchanged shards again.

    Args:
        data: Data folder of a run.
        workers: Renderer or driver processes, as for `readygo generate`; 0 does everything in this process.
    """
    folder = RunFolder(data)
    spec, wanted = folder.load()
    with folder.locked():
        findings = recover_run(folder, every_byte=True)
    console = PlainConsole(stderr=True, soft_wrap=True)
    if not findings.lines:
        console.print("Nothing is lost or damaged.", markup=False)
    with progress_bar() as show:
        summary = record(spec, data, episodes=wanted, workers=workers, show=show)
    console.print(f"{data} holds {summary['episodes']:,} episodes, {summary['samples']:,} samples.", markup=False)
