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
        """Store a blob under its hash; a crash leaves no half-written blob.

        Raises:
            DiskError: If the disk does not take it.
        """
        sha256 = hashlib.sha256(data).hexdigest()
        path = self._folder / sha256
        if self.get(sha256) != data:
            self._write(path, data)
        return sha256

    def _write(self, path: Path, data: bytes) -> None:
        # Without the folder that `write_whole` makes for each file, which takes as long as the writing: nobody else
        # writes here, and what a crash leaves behind goes with the next start.
        part = path.with_name(f".{path.name}")
        try:
            part.write_bytes(data)
            part.replace(path)
        except OSError as error:
            with contextlib.suppress(OSError):
                part.unlink(missing_ok=True)
            raise DiskError(f"{path} cannot be written: {error.strerror or error}.") from error

    def get(self, sha256: str) -> bytes | None:
        """A whole blob, or None."""
        size, data = self.read(sha256, 0, -1)
        return None if size < 0 else data

    def read(self, sha256: str, offset: int, count: int) -> tuple[int, bytes]:
        """The blob's size (-1 if unknown) and `count` bytes from `offset` (-1 for all that follow)."""
        path = self._files.get(sha256, self._folder / Path(sha256).name)
        try:
            with path.open("rb") as file:
                size = os.fstat(file.fileno()).st_size
                file.seek(offset)
                return size, file.read(count)
        except FileNotFoundError:
            return -1, b""

    def drop(self, sha256: str) -> None:
        """Forget a blob that nobody needs any more."""
        (self._folder / sha256).unlink(missing_ok=True)

    def keep_only(self, needed: set[str]) -> None:
        """Forget what an earlier crash left behind."""
        for path in self._folder.iterdir():
            if path.name not in needed:
                path.unlink(missing_ok=True)
