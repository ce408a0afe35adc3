"""Files: reading those that others name, writing such that appear when they are complete, and the user's cache."""

import errno
import io
import os
import re
import shutil
import stat
import sys
import tempfile
import zipfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from readygo.common.errors import ReadygoError

_FOLDER_NAME = re.compile(r"\w[\w.+-]*")
_UNFINISHED_NAME = re.compile(r"\..*-[a-z0-9_]{8}")
"""Of a temporary folder beside what it becomes; the ending is that of `tempfile`."""
_ZIP_DIRECTORY_BYTES_MAX = 2**20
"""A table of contents of 1 MB lists some 15,000 files; Python spends 20 times its size on it."""


def open_regular(path: str | Path) -> io.BufferedReader:
    """Open a file to read it. A pipe, a device or a folder is refused; opening a pipe does not wait for a writer.

    Raises:
        OSError: If it cannot be opened, or is no regular file.
    """
    return os.fdopen(_open_descriptor(path), "rb")


def read_regular(path: str | Path, *, bytes_max: int | None = None) -> bytes:
    """All bytes of a regular file.

    Args:
        path: The file.
        bytes_max: A larger file is refused [bytes].

    Raises:
        OSError: If it cannot be read, is no regular file, or is larger than `bytes_max`.
    """
    with open_regular(path) as stream:
        size = os.fstat(stream.fileno()).st_size
        if bytes_max is not None and size > bytes_max:
            raise OSError(errno.EFBIG, f"it has {size} bytes, more than the {bytes_max} that are read", str(path))
        return stream.read(size)


@contextmanager
def open_zip(path: str | Path) -> Iterator[zipfile.ZipFile]:
    """A zip archive to read from, whose table of contents has a usual size.

    Raises:
        OSError: If it cannot be opened, or is no regular file.
        Exception: zipfile raises many kinds at damaged archives, BadZipFile for most.
    """
    with _ZipStream(io.FileIO(_open_descriptor(path))) as stream, zipfile.ZipFile(stream) as archive:
        stream.bytes_max = sys.maxsize
        yield archive


class _ZipStream(io.BufferedReader):
    """A file that refuses to be read in larger pieces than `bytes_max`."""

    bytes_max = _ZIP_DIRECTORY_BYTES_MAX

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > self.bytes_max:
            raise zipfile.BadZipFile(f"its table of contents has {size} bytes")
        return super().read(size)


def _open_descriptor(path: str | Path) -> int:
    """A descriptor to read a regular file."""
    try:
        descriptor = os.open(path, os.O_RDONLY | os.O_NONBLOCK | os.O_CLOEXEC)
    except ValueError as error:
        raise OSError(errno.EINVAL, "no file can have this name", str(path)) from error
    mode = os.fstat(descriptor).st_mode
    if stat.S_ISREG(mode):
        return descriptor
    os.close(descriptor)
    if stat.S_ISDIR(mode):
        raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR), str(path))
    raise OSError(errno.EINVAL, "it is a pipe or a device, no regular file", str(path))


@contextmanager
def write_then_rename(path: str | Path, *, raises: type[ReadygoError] = ReadygoError) -> Iterator[Path]:
    """A temporary name, with the ending of `path`, that becomes `path` when the block ends well.

    Folders on the way are made. Several processes may do this at once: readers find the file of one of them.

    Args:
        path: The final name.
        raises: What is raised if the file cannot be written.

    Raises:
        ReadygoError: If the file cannot be written.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.stem}-") as folder:
            part = Path(folder) / f"part{path.suffix}"
            yield part
            part.replace(path)
    except OSError as error:
        raise raises(f"{path} cannot be written: {error.strerror or error}.") from error


@contextmanager
def unfinished_folder(
    path: str | Path, *, good: Callable[[], object] | None = None, raises: type[Exception] = ReadygoError
) -> Iterator[Path]:
    """A temporary folder that becomes `path` when the block ends well, and vanishes when it does not.

    Folders on the way are made. Several processes may do this at once: readers find the folder of one of them. Files
    that are open or mapped in a folder that is replaced stay as they were.

    Args:
        path: The final name.
        good: Tells whether the folder that has the name by then may stay: this one is dropped then, else it takes the
            other's place. Without it nothing is replaced.
        raises: What is raised if the folder cannot be written.

    Raises:
        ReadygoError: If the folder cannot be written, or is there already and must not be replaced.
    """
    path = Path(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(dir=path.parent, prefix=f".{path.name}-", ignore_cleanup_errors=True) as place:
            made, old = Path(place) / "new", Path(place) / "old"
            made.mkdir()
            yield made
            while not _rename_folder(made, path):
                if good is None:
                    raise FileExistsError(errno.EEXIST, "it is there already")
                if good():
                    return
                _take_away(path, old)
    except OSError as error:
        raise raises(f"{path} cannot be written: {error.strerror or error}.") from error


def _rename_folder(made: Path, path: Path) -> bool:
    """Rename a folder; False if there is another one that is not empty."""
    try:
        made.rename(path)
    except OSError as error:
        if error.errno in (errno.EEXIST, errno.ENOTEMPTY):
            return False
        raise
    return True


def _take_away(path: Path, old: Path) -> None:
    shutil.rmtree(old, ignore_errors=True)
    # Another process may have been faster.
    with suppress(FileNotFoundError):
        path.rename(old)


def remove_unfinished(folder: Path) -> None:
    """Remove what killed calls of `write_then_rename` and `unfinished_folder` left in a folder, and nothing else."""
    for place in folder.iterdir():
        if not _UNFINISHED_NAME.fullmatch(place.name) or not place.is_dir():
            continue
        # Other programs' hidden folders may have such names too; what cannot be read is not ours.
        with suppress(OSError):
            if all(map(_is_part, place.iterdir())):
                shutil.rmtree(place, ignore_errors=True)


def _is_part(path: Path) -> bool:
    return path.name in ("new", "old") or path.name.startswith("part")


def write_whole(path: str | Path, data: bytes | str, *, raises: type[ReadygoError] = ReadygoError) -> None:
    """Write bytes, or text as UTF-8; see `write_then_rename`.

    Raises:
        ReadygoError: If the file cannot be written.
    """
    with write_then_rename(path, raises=raises) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)


def check_folder_name(name: str) -> None:
    """Raise ValueError for a name that is not fit for a folder on every system, such as "..", "a/b" or an empty one."""
    if not _FOLDER_NAME.fullmatch(name):
        raise ValueError(f"{name!r} is no name of letters, digits, -, +, _ and points; a folder is named so.")


def disk_space(path: Path) -> tuple[int, int]:
    """Room on the disk of a path for whom it is not reserved, and the disk's size [bytes]; zeros if it is gone."""
    try:
        usage = shutil.disk_usage(path)
    except OSError:
        return 0, 0
    return usage.free, usage.total


def cache_root() -> Path:
    """Readygo's part of the user's cache, `$XDG_CACHE_HOME/readygo` or `~/.cache/readygo`; it need not be there."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "readygo"


def cache_folder(name: str) -> Path:
    """A folder below the user's cache for files that can be made again.

    Raises:
        ReadygoError: If nothing can be written there.
    """
    return make_cache_folder(cache_root() / name)


def make_cache_folder(folder: Path) -> Path:
    """Make a folder of the cache where it is missing.

    Raises:
        ReadygoError: If nothing can be written there.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not os.access(folder, os.W_OK):
            raise PermissionError("it is read-only")
    except OSError as error:
        message = f"The cache folder {folder} cannot be used ({error.strerror or error}); "
        raise ReadygoError(f"{message}set XDG_CACHE_HOME to a folder that can be written.") from error
    return folder
