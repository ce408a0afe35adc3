"""Cache folders that all workers of a host share: the first process makes one while others wait for it."""

import fcntl
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager, suppress
from pathlib import Path
from typing import TypeVar

T = TypeVar("T")


def load_or_make(
    folder: Path, load: Callable[[], T | None], make: Callable[[], T], save: Callable[[T, Path], None]
) -> T:
    """What is in a cache folder; made and saved there if it is missing or damaged.

    Args:
        folder: The folder.
        load: Loads it; None if the folder holds nothing valid.
        make: Makes it.
        save: Writes it; raises OSError if it cannot be written.

    Returns:
        What is loaded, or what was made where the folder cannot be written.
    """
    loaded = load()
    if loaded is not None:
        return loaded
    with one_at_a_time(folder):
        # Another process may have made it meanwhile.
        loaded = load()
        if loaded is not None:
            return loaded
        made = make()
        with suppress(OSError):
            save(made, folder)
    loaded = load()
    return made if loaded is None else loaded


@contextmanager
def one_at_a_time(folder: Path) -> Iterator[None]:
    """Keep other processes from making a cache folder; where no lock can be written, every process makes its own."""
    with ExitStack() as stack:
        with suppress(OSError):
            folder.parent.mkdir(parents=True, exist_ok=True)
            lock = stack.enter_context(_lock_of(folder).open("w"))
            fcntl.flock(lock, fcntl.LOCK_EX)
        yield


def is_being_made(folder: Path) -> bool:
    """True if another process is making a cache folder: to load it would wait for that."""
    try:
        with _lock_of(folder).open() as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except BlockingIOError:
        return True
    except OSError:
        # It was never made, or cannot be written here.
        return False
    return False


def _lock_of(folder: Path) -> Path:
    return folder.parent / f".{folder.name}.lock"
