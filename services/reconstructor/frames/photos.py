"""Folders of photos."""

import shutil
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.errors import SceneError
from readygo.common.images.encoded import read_pixels
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.frames.exif import focal_of_35mm, read_exif
from readygo.services.reconstructor.frames.names import usable_name
from readygo.services.reconstructor.frames.video import shrunk, write_jpeg

ENDINGS = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".webp", ".bmp")
PHOTOS_MIN = 3
_TURNED_DEG = {6: 90, 3: 180, 8: 270}
"""By how much photos are turned clockwise, by EXIF's orientation."""


@dataclass(frozen=True, kw_only=True)
class _Photo:
    """A photo that is used."""

    path: Path
    size_px: tuple[int, int]
    """Rows and columns [px]."""
    source_px: tuple[int, int]
    """Rows and columns of the upright file [px]."""
    focal_px: float
    """Focal length by EXIF [px]; 0 if EXIF does not tell it."""
    turned_deg: int
    """By how much the file was turned clockwise to be upright [deg]."""

    @property
    def name(self) -> str:
        """Name of the image that is used, without its folder."""
        return f"{usable_name(self.path.stem)}.jpg"

    @property
    def share(self) -> float:
        """Width as a share of the file's width."""
        return self.size_px[1] / self.source_px[1]

    @property
    def camera(self) -> str:
        """Folder of the photos of its size."""
        return f"{self.size_px[1]}x{self.size_px[0]}"


def photo_files(folder: Path) -> list[Path]:
    """The photos of a folder by name; hidden files are none."""
    return sorted(path for path in folder.iterdir() if path.suffix.lower() in ENDINGS and path.name[0] != ".")


def prepare_photos(source: Path, folder: Path, config: FramesConfig) -> dict[str, Any]:
    """Write the photos of a folder, turned upright and not larger than wanted, as `folder`/NAME.jpg.

    Photos of different sizes come from different cameras: each size has a separate folder. Pictures that are no
    photos of the place, as far as the others tell, are left out; see `_strays`. Names have _ for spaces, see
    `usable_name`.

    Returns:
        What was found: photos, kept, size, size of the files if all have one, unused files, the focal length [px] if
        EXIF tells one of all, by how much all were turned [deg], and of each photo the image that is used, with its
        width as share of the photo's.

    Raises:
        SceneError: If there are too few, or two of them have the same name.
    """
    files = photo_files(source)
    read = [photo for path in files if (photo := _write_photo(path, folder, config.side_max_px)) is not None]
    strays = _strays(read)
    for camera in {photo.camera for photo in strays}:
        shutil.rmtree(folder / camera)
    kept = [photo for photo in read if photo not in strays]
    if len(kept) < PHOTOS_MIN:
        raise SceneError(f"{source} holds {len(kept)} readable photos; {PHOTOS_MIN} are needed, better 50 or more.")
    if len({photo.name for photo in kept}) < len(kept):
        raise SceneError(f"{source} holds photos whose names differ in endings or spaces only; rename them.")
    sizes = sorted({photo.size_px for photo in kept})
    if len(sizes) == 1:
        _flatten(folder)
    focals_px = {photo.focal_px for photo in kept}
    size_px = [list(size[::-1]) for size in sizes]
    used = {photo.path.name: photo.name if len(sizes) == 1 else f"{photo.camera}/{photo.name}" for photo in kept}
    sources, turns = ({getattr(photo, name) for photo in kept} for name in ("source_px", "turned_deg"))
    return {"frames": len(files), "kept": len(kept), "size_px": size_px[0] if len(sizes) == 1 else size_px,
            "source_px": list(sources.pop()[::-1]) if len(sources) == 1 else None,
            "turned_deg": turns.pop() if len(turns) == 1 else 0,
            "unused": [path.name for path in files if path.name not in used],
            "focal_px": focals_px.pop() if len(focals_px) == 1 else 0.0,
            "photos": {photo.path.name: (used[photo.path.name], photo.share) for photo in kept}}  # fmt: skip


def _write_photo(path: Path, folder: Path, side_max_px: int) -> _Photo | None:
    """Write a photo to the folder of its size; None if it cannot be read."""
    # OpenCV turns images as EXIF says.
    bgr = read_pixels(path, cv2.IMREAD_COLOR)
    if bgr is None:
        return None
    small = shrunk(np.asarray(bgr, dtype=np.uint8), side_max_px)
    height, width = small.shape[:2]
    exif = read_exif(path)
    focal_35mm = exif.get("focal_35mm")
    focal_px = round(focal_of_35mm(focal_35mm, width, height), 2) if focal_35mm else 0.0
    source_px = (bgr.shape[0], bgr.shape[1])
    turned_deg = _TURNED_DEG.get(exif.get("orientation", 1), 0)
    photo = _Photo(path=path, size_px=(height, width), source_px=source_px, focal_px=focal_px, turned_deg=turned_deg)
    write_jpeg(folder / photo.camera / photo.name, small)
    return photo


def _strays(photos: Sequence[_Photo]) -> list[_Photo]:
    """Pictures without a focal length whose size hardly any has, where EXIF tells that of all of the other sizes."""
    by_size: dict[tuple[int, int], list[_Photo]] = {}
    for photo in photos:
        by_size.setdefault(photo.size_px, []).append(photo)
    groups = list(by_size.values())
    rare = [group for group in groups if len(group) < PHOTOS_MIN and not any(photo.focal_px for photo in group)]
    others = [photo for group in groups if group not in rare for photo in group]
    if len(others) < PHOTOS_MIN or not all(photo.focal_px for photo in others):
        return []
    return [photo for group in rare for photo in group]


def _flatten(folder: Path) -> None:
    """Move the files of the only subfolder up."""
    (only,) = folder.iterdir()
    for path in sorted(only.iterdir()):
        path.rename(folder / path.name)
    only.rmdir()
