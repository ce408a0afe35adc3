"""Which capture with poses a path holds, and the images of it that are used."""

import os
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import AnyArray
from readygo.common.errors import SceneError
from readygo.common.images.encoded import read_pixels
from readygo.services.reconstructor.frames.config import FramesConfig
from readygo.services.reconstructor.frames.depths import FOLDER as DEPTHS
from readygo.services.reconstructor.frames.names import usable_name
from readygo.services.reconstructor.frames.video import is_same_shape, read_frames, shrunk, write_jpeg
from readygo.services.reconstructor.given.bare_model import find_bare_model, read_bare_model
from readygo.services.reconstructor.given.capture import IMAGES_MIN, GivenCapture
from readygo.services.reconstructor.given.depth import DepthFile, write_depths
from readygo.services.reconstructor.given.polycam import check_polycam, find_polycam, read_polycam
from readygo.services.reconstructor.given.record3d import find_record3d, read_record3d
from readygo.services.reconstructor.given.stray import find_stray, read_stray
from readygo.services.reconstructor.given.transforms import FILE, read_transforms


def read_capture(path: Path) -> GivenCapture | None:
    """The capture with poses at a path.

    It is a `transforms.json`, of Polycam, Record3D or Stray Scanner, or a COLMAP model without tracks.

    Returns:
        None if there is none.

    Raises:
        SceneError: If there is one that cannot be read.
    """
    if path.is_file():
        return read_transforms(path) if path.suffix.lower() == ".json" else None
    model = find_bare_model(path)
    if model is not None:
        return read_bare_model(path, model)
    if (path / FILE).is_file():
        return read_transforms(path / FILE)
    polycam, record3d = find_polycam(path), find_record3d(path)
    if polycam is not None:
        return read_polycam(*polycam)
    if record3d is not None:
        return read_record3d(*record3d)
    stray = find_stray(path)
    if stray is not None:
        return read_stray(stray)
    check_polycam(path)
    return None


def prepare_capture(given: GivenCapture, folder: Path, config: FramesConfig) -> dict[str, Any]:
    """Write the images of a capture that are used, not larger than wanted and not turned, as `folder`/NAME.jpg.

    Names have _ for spaces, see `usable_name`. Depth images become `folder`/depth/NAME.jpg.png, see `write_depths`.

    Returns:
        What was found: frames, kept, size or sizes, `what` wrote it, its unit and up, of each image `lens` (model,
        parameters) and `pose`, files that cannot be used, `depths` (how many), and of each file the image that is used
        with its width as share of the file's. Files whose names repeat are named from the capture's folder on.

    Raises:
        SceneError: If too few images are there, two have the same name, one is there twice, one does not have its
            lens's shape, or depths are impossible.
    """
    _refuse_repeated(given)
    there = [row for row, path in enumerate(given.images) if given.video is not None or path.is_file()]
    chosen = np.unique(np.linspace(0, len(there) - 1, min(len(there), config.count_max)).round().astype(int))
    rows = [there[k] for k in chosen]
    names = dict(zip(rows, _names([given.images[row] for row in rows]), strict=True)) if rows else {}
    told = _told_names(given)
    lenses, poses, sizes, photos, unused = {}, {}, {}, {}, []
    depths: dict[str, DepthFile | None] = {}
    for row, bgr in _pixels(given, rows):
        name, path = names[row], given.images[row]
        if bgr is None:
            unused.append(told[row])
            continue
        source_px = (bgr.shape[1], bgr.shape[0])
        size = given.lenses[row].size_px or source_px
        if not is_same_shape(size, source_px):
            raise SceneError(
                f"{path} is {source_px[0]}x{source_px[1]} px, its lens is for {size[0]}x{size[1]} px: give the images "
                "that the poses were found for."
            )
        small = shrunk(np.asarray(bgr, dtype=np.uint8), config.side_max_px)
        size_px = (small.shape[1], small.shape[0])
        fitted = given.lenses[row].resize(size, size_px)
        write_jpeg(folder / name, small)
        lenses[name], sizes[name] = [fitted.model, *fitted.params], list(size_px)
        poses[name] = given.T_world_camera[row].tolist()
        photos[told[row]] = (name, size_px[0] / source_px[0])
        depths[name] = given.depth[row] if config.depth else None
    if len(lenses) < IMAGES_MIN:
        missing = f"; {given.images[0]} is missing" if not there and given.images else ""
        raise SceneError(f"{len(lenses)} images of this {given.kind} are there; {IMAGES_MIN} are needed{missing}.")
    lost = len(given.images) - len(there)
    notes = [f"{lost} of {len(given.images)} images of the {given.kind} are missing"] if lost else []
    measured, said = write_depths(depths, {name: tuple(size) for name, size in sizes.items()}, folder / DEPTHS)
    notes += said
    all_sizes = sorted({tuple(size) for size in sizes.values()})
    return {"frames": len(given.images), "kept": len(lenses), "notes": notes, "unused": unused,
            "size_px": list(all_sizes[0]) if len(all_sizes) == 1 else [list(size) for size in all_sizes],
            "what": given.kind, "metric": given.metric, "rough": given.rough,
            "up": None if given.up is None else list(given.up),
            "depths": measured, "lens": lenses, "pose": poses, "photos": photos}  # fmt: skip


def _pixels(given: GivenCapture, rows: Sequence[int]) -> Iterator[tuple[int, AnyArray | None]]:
    """Pixels of some images, by their rows; None for one that cannot be read."""
    if given.video is None:
        for row in rows:
            yield row, read_pixels(given.images[row], cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        return
    wanted = {int(given.images[row].stem): row for row in rows}
    for number, (bgr, _) in enumerate(read_frames(given.video)):
        if number in wanted:
            yield wanted.pop(number), bgr
        if not wanted:
            return
    yield from ((row, None) for row in wanted.values())


def _refuse_repeated(given: GivenCapture) -> None:
    repeated = [path for path, count in Counter(map(os.path.abspath, given.images)).items() if count > 1]
    if repeated:
        raise SceneError(
            f"The {given.kind} has {len(repeated)} images twice or more, {Path(repeated[0]).name} among them; leave "
            "one pose of each."
        )


def _told_names(given: GivenCapture) -> list[str]:
    """Names that a user knows the files by: their own, or from the capture's folder on where these are not unique."""
    counts = Counter(path.name for path in given.images)
    if len(counts) == len(given.images):
        return list(counts)
    folder = os.path.commonpath([os.path.abspath(path) for path in (*given.files, *given.images)])
    return [
        path.name if counts[path.name] == 1 else Path(os.path.abspath(path)).relative_to(folder).as_posix()
        for path in given.images
    ]


def _names(paths: list[Path]) -> list[str]:
    """Names of the images that are used: the files' own, or with their folder where these are not unique."""
    stems = [usable_name(path.stem) for path in paths]
    if len(set(stems)) == len(stems):
        return [f"{stem}.jpg" for stem in stems]
    # Without "..", with which an image would be written elsewhere.
    nested = [usable_name(f"{Path(os.path.normpath(path)).parent.name}/{path.stem}") for path in paths]
    if len(set(nested)) < len(nested):
        raise SceneError(f"{paths[0].parent} holds images whose names differ in endings or spaces only; rename them.")
    return [f"{name}.jpg" for name in nested]
