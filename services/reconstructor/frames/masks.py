"""Masks of images: which pixels are not to be looked at, as people who walk through the film.

A mask is an image as large as its own, named after it with `.png` at the end (a.jpg.png, as COLMAP has it; a.png does
too); 0 is ignored, all else counts.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import UInt8Array
from readygo.common.errors import SceneError
from readygo.common.files import write_whole
from readygo.common.images.encoded import read_pixels
from readygo.services.reconstructor.frames.video import is_same_shape

FOLDER = "masks"
_INVERTED = 0.6
"""Masks that hide a larger share of the images are likely to mean the opposite."""
_HIDDEN_MAX = 0.9
"""Masks that hide a larger share leave no place to be made."""
_KEEPS = 255


def mask_of(folder: Path, names: Sequence[str]) -> Path | None:
    """The mask of an image, by any of its names; None if there is none."""
    places = [folder / f"{name}.png" for name in names]
    places += [(folder / name).with_suffix(".png") for name in names]
    return next((place for place in places if place.is_file()), None)


def mask_files(folder: Path) -> list[Path]:
    """All masks of a folder.

    Raises:
        SceneError: If there is no such folder, or no mask in it.
    """
    files = sorted(folder.rglob("*.png")) if folder.is_dir() else []
    if not files:
        raise SceneError(f"{folder} holds no masks; name them after their images, as a.jpg.png, with 0 for ignore.")
    return files


def prepare_masks(
    masks: Path, images: Path, names: Sequence[str], photos: Mapping[str, Any], folder: Path
) -> dict[str, Any]:
    """Write the masks of the images that are used as `folder`/NAME.png, as large as these, with 0 and 255.

    Args:
        masks: Folder of the masks.
        images: Folder of the images that are used.
        names: The images that are used.
        photos: Of each file of the source, the image that is used and more.
        folder: Where to write.

    Returns:
        `masked`: the mean share of the pixels that are ignored; `notes`.

    Raises:
        SceneError: If a mask is missing, cannot be read, or has another shape than its image, or if masks hide nearly
            all.
    """
    mask_files(masks)
    sources: dict[str, list[str]] = {name: [name] for name in names}
    for source, (used, *_) in photos.items():
        sources[used].insert(0, source)
    found = {name: mask_of(masks, sources[name]) for name in names}
    missing = [name for name, path in found.items() if path is None]
    if missing:
        raise SceneError(
            f"{masks} has no mask of {len(missing)} of {len(names)} images, {missing[0]}.png among them; a mask that "
            "is white all over ignores nothing."
        )
    shares = []
    for name, path in found.items():
        assert path is not None
        mask = _fitted(path, _size_of(images / name), name)
        shares.append(float((mask == 0).mean()))
        write_whole(folder / f"{name}.png", cv2.imencode(".png", mask)[1].tobytes(), raises=SceneError)
    masked = float(np.mean(shares))
    if masked > _HIDDEN_MAX:
        raise SceneError(
            f"{masks} hides {100 * masked:.0f} % of the images in the mean: too little is left to make a place of. 0 "
            "stands for what is to be ignored; if that is right, film when fewer people are there."
        )
    notes = [f"masks hide {100 * masked:.0f} % of the images in the mean"]
    if masked > _INVERTED:
        notes = [f"{notes[0]}: check that 0 stands for what is to be ignored"]
    return {"masked": round(masked, 4), "notes": notes}


def read_mask(path: Path) -> UInt8Array | None:
    """A mask with 0 and 255, shape (H, W); None if there is no such file, or it is none that can be decoded."""
    pixels = read_pixels(path, cv2.IMREAD_UNCHANGED)
    if pixels is None:
        return None
    # Colour images count where any colour does; what an alpha channel says is not asked for.
    grey = pixels if pixels.ndim == 2 else pixels[:, :, :3].max(axis=2)
    return np.where(grey > 0, _KEEPS, 0).astype(np.uint8)


def shrink_mask(mask: UInt8Array, size_px: tuple[int, int]) -> UInt8Array:
    """A mask of another size: a pixel counts if all do that it is made of.

    Args:
        mask: Shape (H, W).
        size_px: Width and height that are wanted.
    """
    if mask.shape[::-1] == size_px:
        return mask
    area = cv2.resize(mask, size_px, interpolation=cv2.INTER_AREA)
    return np.where(area == _KEEPS, _KEEPS, 0).astype(np.uint8)


def _fitted(path: Path, size_px: tuple[int, int], name: str) -> UInt8Array:
    mask = read_mask(path)
    if mask is None:
        raise SceneError(f"{path} cannot be read as a mask.")
    height, width = mask.shape
    if not is_same_shape((width, height), size_px):
        raise SceneError(f"{path} is {width}x{height} px, its image {name} {size_px[0]}x{size_px[1]} px.")
    return shrink_mask(mask, size_px)


def _size_of(image: Path) -> tuple[int, int]:
    """Width and height of an image that is used."""
    pixels = read_pixels(image, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if pixels is None:
        raise SceneError(f"{image} cannot be read as an image.")
    return pixels.shape[1], pixels.shape[0]
