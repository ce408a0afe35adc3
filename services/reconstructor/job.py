"""What a job begins with, and where in its folder what comes of it lies."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.common.errors import SceneError
from readygo.services.reconstructor.config import ReconstructorConfig
from readygo.services.reconstructor.frames.photos import photo_files
from readygo.services.reconstructor.given.depth import absent_modules
from readygo.services.reconstructor.given.find import read_capture
from readygo.services.reconstructor.poses import colmap
from readygo.services.reconstructor.stages import identity_of

FRAMES, MARKERS, FEATURES, MATCHES, MAP, POSED = "frames", "markers", "features", "matches", "map", "posed"
"""Stages, and folders of the job."""
EXHAUSTIVE_MAX = 120
"""Up to this many photos each is matched with each; more are taken as a sequence in the order of their names."""
POSE_STAGES = (FRAMES, MARKERS, FEATURES, MATCHES, MAP, POSED)
DATABASE_FILE, PICTURE_FILE, REPORT_FILE = "database.db", "top.png", "poses.json"


@dataclass(frozen=True, kw_only=True)
class Source:
    """What a job begins with."""

    path: Path
    kind: str
    """video, photos, colmap, or capture: images with poses of another program."""
    identity: tuple[tuple[str, int, int], ...]
    """Name, size and time of change of each file."""


def open_source(path: Path) -> Source:
    """Tell what a path is.

    Raises:
        SceneError: If it is nothing to begin with, or images of a COLMAP model are missing.
    """
    if not path.exists():
        raise SceneError(
            f"{path} does not exist; give a video, a folder of photos, a folder with a COLMAP model, a "
            "transforms.json, or an export of Polycam, Record3D or Stray Scanner."
        )
    model = None if path.is_file() else colmap.find_model(path)
    given = read_capture(path)
    if model is not None and given is None:
        folder = images_of_model(path)
        images = [folder / name for name in colmap.image_names(model)]
        missing = [image for image in images if not image.is_file()]
        if missing:
            raise SceneError(f"{path} lacks {len(missing)} images of its COLMAP model, {missing[0]} among them.")
        return Source(path=path, kind="colmap", identity=identity_of([*colmap.model_files(model), *images]))
    if given is not None:
        # Depths that could not be read are read once their module is there.
        absent = tuple((module, 0, 0) for module in absent_modules(given.depth))
        return Source(path=path, kind="capture", identity=identity_of(given.all_files) + absent)
    if path.is_file():
        return Source(path=path, kind="video", identity=identity_of([path]))
    photos = photo_files(path)
    if not photos:
        raise SceneError(f"{path} holds no photos (.jpg, .png, .tif, ...), no COLMAP model and no other poses.")
    return Source(path=path, kind="photos", identity=identity_of(photos))


def images_of_model(path: Path) -> Path:
    """The images of a COLMAP model.

    Raises:
        SceneError: If there are none beside it.
    """
    folder = path / "images"
    if not folder.is_dir():
        raise SceneError(f"{path} holds a COLMAP model but no folder images/.")
    return folder.resolve()


def images_of(frames: Mapping[str, Any], folder: Path) -> tuple[Path, list[str]]:
    """Folder of the images, and their names."""
    return Path(frames.get("images", folder)), list(frames["names"])


def in_order(kind: str, count: int, config: ReconstructorConfig) -> bool:
    """True if images are taken for such as follow each other: those of a video, or many photos."""
    return kind == "video" or (kind in ("photos", "capture") and count > EXHAUSTIVE_MAX)
