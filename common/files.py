"""Files that appear under their name only when they are complete."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from readygo.common.errors import ReadygoError


@contextmanager
def unfinished(path: str | Path, *, raises: type[ReadygoError] = ReadygoError) -> Iterator[Path]:
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


def write_whole(path: str | Path, data: bytes | str, *, raises: type[ReadygoError] = ReadygoError) -> None:
    """Write bytes, or text as UTF-8; see `unfinished`.

    Raises:
        ReadygoError: If the file cannot be written.
    """
    with unfinished(path, raises=raises) as part:
        part.write_bytes(data.encode() if isinstance(data, str) else data)
