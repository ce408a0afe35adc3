"""`readygo requeue`: replaces the episodes of a recorder whose disk is lost."""

import sys
from dataclasses import dataclass
from pathlib import Path

from tyro.conf import Positional

from readygo.runs.folder import RunFolder
from readygo.runs.recorders import requeue as requeue_recorder


@dataclass(frozen=True, kw_only=True)
class RequeueOptions:
    """Remove a recorder whose disk is lost from a run: its episodes are recorded again when the run resumes.

    The recorder is not used again, and its shards do not return to the dataset if the disk does.
    """

    data: Positional[Path]
    """Data folder of a run that no fleet is working on."""
    recorder: str
    """Name of the recorder."""


def requeue(options: RequeueOptions) -> None:
    """Remove a recorder whose disk is lost from a run: its episodes are recorded again when the run resumes."""
    folder = RunFolder(options.data)
    folder.load()
    with folder.lock():
        count = requeue_recorder(folder, options.recorder)
    command = "coordinator" if folder.elsewhere.exists() else "recover"
    sys.stdout.write(
        f"Recorder {options.recorder} is given up: "
        f"its {count} episodes are recorded again by the command that began the run, "
        f"or by `readygo {command} {options.data}`.\n"
    )
