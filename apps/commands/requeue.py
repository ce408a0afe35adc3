"""`readygo requeue`: a recorder whose disk is gone."""

import sys
from pathlib import Path

from readygo.apps.run.folder import RunFolder
from readygo.apps.run.recorders import requeue as requeue_recorder


def requeue(data: Path, /, *, recorder: str) -> None:
    """Give up a recorder whose disk is gone: its episodes are recorded again when the run goes on.

    The recorder is not used any more, and its shards are none of the dataset's, should the disk come back.

    Args:
        data: Data folder of a run that no fleet is at work on.
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
