"""Folders of photos."""

from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.errors import SceneError
from readygo.services.reconstructor.config import FramesConfig
from readygo.services.reconstructor.frames.exif import focal_of_35mm, read_exif
from readygo.services.reconstructor.frames.video import shrunk, write_jpeg

ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp")
PHOTOS_MIN = 3


def photo_files(folder: Path) -> list[Path]:
    """The photos of a folder by name; hidden files are none."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS and path.name[0] != ".")


def prepare_photos(source: Path, folder: Path, config: FramesConfig) -> dict[str, Any]:
    """Write the photos of a folder, turned upright and not larger than wanted, as `folder`/NAME.jpg.

    Photos of different sizes come from different cameras: each size has a folder of its own.

    Returns:
        What was found: photos, kept, size, unreadable files, the focal length [px] if EXIF tells one of all, and of
        each photo the image that is used, with its width as share of the photo's.

    Raises:
        SceneError: If there are too few.
    """
    files = photo_files(source)
    kept, unreadable, focals_px = [], [], set()
    shares: dict[str, float] = {}
    for path in files:
        # imread turns images as EXIF says.
        bgr = cv2.imread(str(path))
        if bgr is None:
            unreadable.append(path.name)
            continue
        small = shrunk(np.asarray(bgr, dtype=np.uint8), config.side_max_px)
        height, width = small.shape[:2]
        kept.append((path.stem, small.shape[:2]))
        shares[path.name] = width / bgr.shape[1]
        focal_35mm = read_exif(path).get("focal_35mm")
        focals_px.add(round(focal_of_35mm(focal_35mm, width, height), 2) if focal_35mm else 0.0)
        write_jpeg(folder / f"{width}x{height}" / f"{path.stem}.jpg", small)
    if len(kept) < PHOTOS_MIN:
        raise SceneError(f"{source} holds {len(kept)} readable photos; {PHOTOS_MIN} are needed, better 50 or more.")
    if len({name for name, _ in kept}) < len(kept):
        raise SceneError(f"{source} holds photos whose names differ in their endings only; rename them.")
    sizes = sorted({size for _, size in kept})
    if len(sizes) == 1:
        _flatten(folder)
    focal_px = focals_px.pop() if len(focals_px) == 1 else 0.0
    size_px = [list(size[::-1]) for size in sizes]
    names = [stem if len(sizes) == 1 else f"{size[1]}x{size[0]}/{stem}" for stem, size in kept]
    photos = {path: (f"{name}.jpg", share) for name, (path, share) in zip(names, shares.items(), strict=True)}
    return {"frames": len(files), "kept": len(kept), "size_px": size_px[0] if len(sizes) == 1 else size_px,
            "unreadable": unreadable, "focal_px": focal_px, "photos": photos}  # fmt: skip


def _flatten(folder: Path) -> None:
    """Move the files of the only subfolder up."""
    (only,) = folder.iterdir()
    for path in sorted(only.iterdir()):
        path.rename(folder / path.name)
    only.rmdir()
