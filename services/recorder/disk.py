"""Disks that take nothing: what is said of them, and whether they take something again."""

import errno
from contextlib import suppress
from pathlib import Path

from readygo.common.errors import NO_ROOM, DiskError, RunError

ROOM_BYTES = 2**20
"""A disk takes something again when it takes so much."""
_READ_ONLY = (errno.EROFS, errno.EACCES, errno.EPERM)


def disk_error(folder: Path, error: OSError) -> RunError:
    """What is said of a write that failed: a DiskError if the disk is full or read-only and can be waited for."""
    if error.errno in NO_ROOM:
        return DiskError(f"No space left in {folder}; free some, and recording continues.")
    if error.errno in _READ_ONLY:
        return DiskError(f"{folder} cannot be written ({error.strerror}); fix that, and recording continues.")
    return RunError(f"Writing to {folder} failed: {error.strerror or error}; fix that and run again to resume.")


def try_room(folder: Path, name: str) -> None:
    """Write a file for a recorder, and remove it.

    Raises:
        RunError: If that failed; DiskError if the disk is full or read-only.
    """
    probe = folder / f".room-{name}"
    try:
        probe.write_bytes(bytes(ROOM_BYTES))
    except OSError as error:
        raise disk_error(folder, error) from error
    finally:
        with suppress(OSError):
            probe.unlink(missing_ok=True)
