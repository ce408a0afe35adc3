"""`readygo requeue`: replaces the episodes of a recorder whose disk is lost."""

import sys
from pathlib import Path

from readygo.apps.run.folder import RunFolder
from readygo.apps.run.recorders import requeue as requeue_recorder


def requeue(data: Path, /, *, recorder: str) -> None:
    """Remove a recorder whose disk is lost from a run: its episodes are recorded again when the run resumes.

    The recorder is not used again, and its shards do not return to the dataset if the disk does.

    Args:
        data: Data folder of a run that no fleet is working on.
        recorder: Name of the recorder.
    """
    folder = RunFolder(data)
    folder.load()
    with folder.locked():
        count = requeue_recorder(folder, recorder)
    command = "coordinator" if folder.elsewhere.exists() else "recover"
    sys.stdout.write(
        f"Recorder {recorder} is given up: its {count} episodes are recorded again by the command that began the run, "
        f"or by `readygo {command} {data}`.\n"
    )
