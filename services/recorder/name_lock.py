"""A recorder's name in a folder, which one process has at a time."""

import os
from pathlib import Path

from readygo.common.errors import RunError
from readygo.common.locks import hold

LEAVING_S = 10.0
"""Time that another process of the name has to end, whose parent may be gone a moment ago [s]."""


class NameLock:
    """Held from when it is made until it is released, or the process ends."""

    def __init__(self, folder: Path, name: str) -> None:
        """Wait for another process to leave.

        Raises:
            RunError: If it does not.
        """
        self._path = folder / f".recorder-{name}.lock"
        self._descriptor = hold(self._path, patience_s=LEAVING_S)
        if self._descriptor is None:
            raise RunError(f"Recorder {name} is recording into {folder} already; stop it, or choose another name.")

    def release(self) -> None:
        """Leave the name to others."""
        if self._descriptor is not None:
            self._path.unlink(missing_ok=True)
            os.close(self._descriptor)
            self._descriptor = None
