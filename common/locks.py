"""Files that one process at a time holds; the operating system lets go of them when the process dies."""

import fcntl
import os
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from readygo.common.errors import RunError

POLL_S = 0.1


def hold(path: Path, *, patience_s: float = 0.0) -> int | None:
    """Lock a file, which is made if it is missing.

    Args:
        path: The file.
        patience_s: How long to wait for another process that holds it [s].

    Returns:
        A descriptor that holds the lock until it is closed; None if another process does.

    Raises:
        OSError: If the file cannot be made, or its disk knows no locks.
    """
    deadline_s = time.monotonic() + patience_s
    while True:
        descriptor = os.open(path, os.O_RDWR | os.O_CREAT, 0o644)
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            os.close(descriptor)
        except OSError:
            os.close(descriptor)
            raise
        else:
            if _is_still(path, descriptor):
                return descriptor
            os.close(descriptor)
            continue
        if time.monotonic() >= deadline_s:
            return None
        time.sleep(POLL_S)


@contextmanager
def held(path: Path, *, patience_s: float = 0.0) -> Iterator[int | None]:
    """Lock a file, which is made with its folder if missing, while the context is active; yields what `hold` returns.

    Raises:
        RunError: If the file cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        descriptor = hold(path, patience_s=patience_s)
    except OSError as error:
        raise RunError(f"{path.parent} cannot be written: {error.strerror}.") from error
    try:
        yield descriptor
    finally:
        if descriptor is not None:
            os.close(descriptor)


def _is_still(path: Path, descriptor: int) -> bool:
    """False if who held the file before has removed it meanwhile: others would lock another one."""
    try:
        return os.path.samestat(path.stat(), os.fstat(descriptor))
    except FileNotFoundError:
        return False
