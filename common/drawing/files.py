"""Pictures as bytes and files; a file appears under its name only when it is complete."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import cv2
import numpy as np
import numpy.typing as npt

from common.errors import ReadygoError

Picture = npt.NDArray[np.uint8]
JPEG_QUALITY = 90


def png_bytes(rgb: Picture) -> bytes:
    """A picture (H, W, 3) as PNG."""
    return _encoded(rgb, ".png", [cv2.IMWRITE_PNG_COMPRESSION, 9])


def jpeg_bytes(rgb: Picture) -> bytes:
    """A picture (H, W, 3) as JPEG."""
    return _encoded(rgb, ".jpg", [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])


def write_png(path: Path, rgb: Picture) -> None:
    """Write a picture (H, W, 3) as PNG; folders on the way are made.

    Raises:
        ReadygoError: If it cannot be written.
    """
    data = png_bytes(rgb)
    with unfinished(path) as part:
        part.write_bytes(data)


@contextmanager
def unfinished(path: Path) -> Iterator[Path]:
    """A temporary name, with the ending of `path`, that becomes `path` when the block ends well.

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
        raise ReadygoError(f"{path} cannot be written: {error.strerror or error}.") from error


def _encoded(rgb: Picture, ending: str, options: list[int]) -> bytes:
    done, data = cv2.imencode(ending, np.ascontiguousarray(rgb[:, :, ::-1]), options)
    assert done
    return bytes(data.tobytes())
