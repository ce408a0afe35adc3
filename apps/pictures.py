"""Pictures as files."""

import os
from pathlib import Path

import numpy as np
import numpy.typing as npt

from common.errors import ReadygoError


def require_png(option: str, path: Path | None) -> None:
    """Refuse another format.

    Raises:
        ReadygoError: If the file's name does not end in .png.
    """
    if path is not None and path.suffix.lower() != ".png":
        raise ReadygoError(f"{option} {path} must end in .png.")


def write_png(path: Path, rgb: npt.NDArray[np.uint8]) -> None:
    """Write a picture (H, W, 3), its folder too; the file appears only once it is complete."""
    import cv2

    done, data = cv2.imencode(".png", rgb[:, :, ::-1])
    assert done
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(path.name + ".part")
    part.write_bytes(bytes(data))
    os.replace(part, path)
