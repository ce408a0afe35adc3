"""Content-addressed results on disk."""

import contextlib
import hashlib
import os
from collections.abc import Mapping
from pathlib import Path

from readygo.common.errors import DiskError


class BlobStore:
    """Blobs in a folder, named by their SHA-256; files of the run's scene are served from their place."""

    def __init__(self, folder: Path, files: Mapping[str, Path] | None = None) -> None:
        self._folder = folder
        self._files = dict(files or {})
        folder.mkdir(parents=True, exist_ok=True)

    def put(self, data: bytes) -> str:
        """Store a blob under its hash.

        Raises:
            DiskError: If the disk does not take it.
        """
        sha256 = hashlib.sha256(data).hexdigest()
        path = self._path(sha256)
        try:
            try:
                _write(path, data, os.O_EXCL)
            except FileExistsError:
                if self.get(sha256) != data:
                    _write(path, data, os.O_TRUNC)
        except OSError as error:
            raise DiskError(f"{path} cannot be written: {error.strerror or error}.") from error
        return sha256

    def get(self, sha256: str) -> bytes | None:
        """A whole blob, or None."""
        size, data = self.read(sha256, 0, -1)
        return None if size < 0 else data

    def read(self, sha256: str, offset: int, count: int) -> tuple[int, bytes]:
        """The blob's size (-1 if unknown) and `count` bytes from `offset` (-1 for all that follow)."""
        try:
            descriptor = os.open(self._files.get(sha256) or self._path(sha256), os.O_RDONLY)
        except FileNotFoundError:
            return -1, b""
        try:
            size = os.fstat(descriptor).st_size
            return size, _read(descriptor, offset, size if count < 0 else min(count, size - offset))
        finally:
            os.close(descriptor)

    def drop(self, sha256: str) -> None:
        """Delete a blob that is not needed any more."""
        with contextlib.suppress(FileNotFoundError):
            os.unlink(self._path(sha256))

    def keep_only(self, needed: set[str]) -> None:
        """Forget what an earlier crash left behind."""
        for path in self._folder.iterdir():
            if path.name not in needed:
                path.unlink(missing_ok=True)

    def _path(self, sha256: str) -> str:
        return os.path.join(self._folder, os.path.basename(sha256))


def _write(path: str, data: bytes, how: int) -> None:
    """Write a file directly under its final name: nothing refers to what a crash leaves, and its hash differs."""
    descriptor = os.open(path, os.O_WRONLY | os.O_CREAT | how, 0o644)
    try:
        view = memoryview(data)
        while view:
            view = view[os.write(descriptor, view) :]
    except OSError:
        os.unlink(path)
        raise
    finally:
        os.close(descriptor)


def _read(descriptor: int, offset: int, count: int) -> bytes:
    """So many bytes of a file from `offset`, or those that there are."""
    data = os.pread(descriptor, max(count, 0), offset)
    while 0 < len(data) < count and (more := os.pread(descriptor, count - len(data), offset + len(data))):
        data += more
    return data
