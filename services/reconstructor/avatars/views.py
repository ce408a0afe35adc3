"""The frames of a film as the fit sees them: cut out around the person, at some size, with checks of the masks."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array, UInt8Array
from readygo.common.errors import AvatarError
from readygo.common.images.encoded import read_pixels
from readygo.services.reconstructor.avatars.footage import Footage

MARGIN_SHARE = 0.06
"""What is kept around the person's box, in sides of the box; the person may be a bit beyond the mask."""
_MARGIN_PX = 12
_PERSON_MIN_PX, _PERSON_MIN_SIDE_PX = 200, 40
"""Pixels of a mask, and its longer side, below which there is too little to see; as few black ones are none, too."""
_SECOND_SHARE, _SECOND_FRAMES = 0.3, 0.2
"""Another piece of a mask of this share of the largest one is another person, if it is in so many frames."""
BAND_SHARE = 0.03
"""Before plates masks are believed so far from their border, as a share of the longer side of the person's box."""
_CUT_FRAMES = 0.5
_EMPTY_FRAMES = 0.1


@dataclass(frozen=True, kw_only=True, eq=False)
class PersonView:
    """One frame, cut out."""

    rgb: Float32Array
    """Colours in 0..1, shape (3, H, W)."""
    mask: Float32Array
    """Share of each pixel that the person covers, shape (H, W)."""
    inner: Float32Array
    """1 where a pixel is not at the mask's border, where colours are mixed, shape (H, W)."""
    plate: Float32Array | None
    """What the frame would show without the person, colours in 0..1, shape (3, H, W); see `plates`."""
    sure: Float32Array
    """1 where the mask is believed, shape (H, W): everywhere without a plate, else away from its border."""
    K_px: Float64Array
    T_world_camera: Float64Array


@dataclass(frozen=True, kw_only=True, eq=False)
class PersonMask:
    """Where the person is in an image: only the part around the person is kept, as photos of a phone are large."""

    cut: BoolArray
    """The mask around the person, shape (h, w)."""
    top: int
    left: int
    shape: tuple[int, int]
    """Height and width of the image."""

    @classmethod
    def of_whole(cls, mask: BoolArray) -> "PersonMask":
        """The part of a mask around the person; all of it without one."""
        top, left, bottom, right = _box(mask)
        return cls(cut=mask[top:bottom, left:right].copy(), top=top, left=left, shape=mask.shape)

    def whole(self) -> BoolArray:
        """The mask of the whole image, shape (H, W)."""
        mask = np.zeros(self.shape, dtype=np.bool_)
        mask[self.rows, self.columns] = self.cut
        return mask

    @property
    def rows(self) -> slice:
        """Rows of the image that are kept."""
        return slice(self.top, self.top + self.cut.shape[0])

    @property
    def columns(self) -> slice:
        """Columns of the image that are kept."""
        return slice(self.left, self.left + self.cut.shape[1])

    @property
    def is_cut_off(self) -> bool:
        """True if the person reaches the lower border of the image."""
        return self.rows.stop == self.shape[0] and bool(self.cut[-1].any())


@dataclass(frozen=True, kw_only=True, eq=False)
class FilmedPerson:
    """All frames, cut out around the person, and what was noticed of them."""

    rgb: tuple[UInt8Array, ...]
    mask: tuple[BoolArray, ...]
    K_px: Float64Array
    """Intrinsics of the cut-outs, shape (F, 3, 3)."""
    T_world_camera: Float64Array
    notes: tuple[str, ...]
    """Hints for the user."""
    plates: tuple[UInt8Array, ...] | None = None
    """What the frames would show without the person, shape (H, W, 3) each, where the scene is known."""
    plate_colours: Float64Array | None = None
    """Gains, and offsets in 0..1, that make the scene's colours those of the photos, shape (F, 2, 3)."""

    def __len__(self) -> int:
        return len(self.rgb)


def read_person(footage: Footage, side_max_px: int) -> FilmedPerson:
    """Read images and masks of a film.

    Args:
        footage: The film.
        side_max_px: Larger images are made smaller.

    Raises:
        AvatarError: If an image or mask cannot be read, does not fit the other, or shows no one or two people.
    """
    masks, notes = read_masks(footage.masks, footage.sizes_px)
    shrink = min(1.0, side_max_px / int(footage.sizes_px.max()))
    rgb, cut, K = [], [], footage.K_px.copy()
    for number, mask in enumerate(masks):
        # One at a time: a hundred photos of a telephone do not fit into memory.
        image = read_rgb(footage.images[number], "image")
        if image.shape[:2] != mask.shape:
            width, height = footage.sizes_px[number].tolist()
            raise AvatarError(
                f"{footage.images[number]} has {image.shape[1]}x{image.shape[0]} px, its camera {width}x{height} px."
            )
        K[number, :2, 2] -= (mask.left, mask.top)
        part, where = image[mask.rows, mask.columns].copy(), mask.cut
        if shrink < 1.0:
            part, where = _shrink(part, where, K[number], shrink)
        rgb.append(part)
        cut.append(where)
    return FilmedPerson(
        rgb=tuple(rgb), mask=tuple(cut), K_px=K, T_world_camera=footage.T_world_camera, notes=tuple(notes)
    )


def read_masks(paths: Sequence[Path], sizes_px: Int64Array) -> tuple[list[PersonMask], list[str]]:
    """Where the person is in each image, and hints about what is cut off.

    Args:
        paths: The masks.
        sizes_px: Width and height of the images, shape (F, 2).

    Raises:
        AvatarError: If a mask cannot be read, does not fit its image, or they show no one, everything or two people.
    """
    masks, borders, whole = [], [], []
    for path in paths:
        mask = _read_mask(path)
        borders.append(_border(mask))
        if np.count_nonzero(mask) > mask.size - _PERSON_MIN_PX:
            whole.append(path)
        # In some data sets the person is black. What most masks show is known at the end.
        masks.append(PersonMask.of_whole(~mask if borders[-1] > 0.5 else mask))
    black = bool(np.mean(borders) > 0.5)
    for number, path in enumerate(paths):
        if (borders[number] > 0.5) != black:
            mask = _read_mask(path)
            masks[number] = PersonMask.of_whole(~mask if black else mask)
    for path, found, (width, height) in zip(paths, masks, sizes_px.tolist(), strict=True):
        if found.shape != (height, width):
            raise AvatarError(f"{path} has {found.shape[1]}x{found.shape[0]} px, its image {width}x{height} px.")
    if whole:
        raise AvatarError(
            f"{len(whole)} of {len(paths)} masks are white all over, {whole[0].name} among them: they show the whole "
            "image; only the person must be white."
        )
    return masks, _check_masks(paths, masks)


def view_at(person: FilmedPerson, number: int, fraction: int) -> PersonView:
    """A frame at a fraction of its size."""
    rgb, mask = person.rgb[number], person.mask[number].astype(np.float32)
    height, width = max(8, round(rgb.shape[0] / fraction)), max(8, round(rgb.shape[1] / fraction))
    K = person.K_px[number].copy()
    K[0] *= width / rgb.shape[1]
    K[1] *= height / rgb.shape[0]
    if fraction > 1:
        mask = np.asarray(cv2.resize(mask, (width, height), interpolation=cv2.INTER_AREA), dtype=np.float32)
    kernel = np.ones((3, 3), dtype=np.uint8)
    plate, sure = None, np.ones_like(mask)
    if person.plates is not None:
        plate = _sized(person.plates[number], (width, height))
        band = band_px(person.mask[number])
        edge = widened(person.mask[number], band) & widened(~person.mask[number], band)
        sure = np.asarray(
            cv2.resize((~edge).astype(np.float32), (width, height), interpolation=cv2.INTER_AREA) > 0.999, np.float32
        )
    inner = cv2.erode((mask > 0.999).astype(np.uint8), kernel) + (
        1 - cv2.dilate((mask > 0.001).astype(np.uint8), kernel)
    )
    return PersonView(
        rgb=_sized(rgb, (width, height)),
        mask=mask,
        inner=inner.astype(np.float32),
        plate=plate,
        sure=sure,
        K_px=K,
        T_world_camera=person.T_world_camera[number],
    )


def _sized(image: UInt8Array, size_px: tuple[int, int]) -> Float32Array:
    """Colours in 0..1, shape (3, H, W), of an image that is made smaller."""
    if image.shape[1::-1] != size_px:
        image = np.asarray(cv2.resize(image, size_px, interpolation=cv2.INTER_AREA), dtype=np.uint8)
    return np.ascontiguousarray(image.transpose(2, 0, 1)).astype(np.float32) / np.float32(255)


def band_px(mask: BoolArray) -> int:
    """How far from its border a mask is not believed before a plate [px], at least one."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    side = max((float(np.ptp(part)) for part in (rows, columns) if len(part)), default=0.0)
    return max(1, round(BAND_SHARE * side))


def widened(mask: BoolArray, by_px: int) -> BoolArray:
    """A mask with what is at most so far from it."""
    kernel = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * by_px + 1, 2 * by_px + 1))
    return np.asarray(cv2.dilate(mask.astype(np.uint8), kernel) > 0)


def read_rgb(path: Path, what: str) -> UInt8Array:
    """The pixels of an image or a mask, shape (H, W, 3).

    Raises:
        AvatarError: If there is no such file, or it cannot be decoded.
    """
    # Cameras are of the pixels as they lie in the file: EXIF does not turn them.
    pixels = read_pixels(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
    if pixels is None:
        raise AvatarError(f"{path} cannot be read as {'an' if what == 'image' else 'a'} {what}.")
    return np.ascontiguousarray(pixels[:, :, ::-1])


def _read_mask(path: Path) -> BoolArray:
    return np.asarray(read_rgb(path, "mask").max(axis=2) > 127)


def _border(mask: BoolArray) -> float:
    return float(np.mean(np.concatenate([mask[0], mask[-1], mask[:, 0], mask[:, -1]])))


def _box(mask: BoolArray) -> tuple[int, int, int, int]:
    """Top, left, bottom, right of the person with a margin; the whole image without one."""
    rows, columns = np.flatnonzero(mask.any(axis=1)), np.flatnonzero(mask.any(axis=0))
    if len(rows) == 0:
        return 0, 0, mask.shape[0], mask.shape[1]
    margin = _MARGIN_PX + round(MARGIN_SHARE * max(rows[-1] - rows[0], columns[-1] - columns[0]))
    return (
        max(int(rows[0]) - margin, 0),
        max(int(columns[0]) - margin, 0),
        min(int(rows[-1]) + margin + 1, mask.shape[0]),
        min(int(columns[-1]) + margin + 1, mask.shape[1]),
    )


def _check_masks(paths: Sequence[Path], masks: list[PersonMask]) -> list[str]:
    """Refuse masks that show no one, too little, or two people; hints about what is cut off."""
    count, cuts = len(masks), [mask.cut for mask in masks]
    empty = [number for number, mask in enumerate(cuts) if mask.sum() < _PERSON_MIN_PX]
    if len(empty) > _EMPTY_FRAMES * count:
        raise AvatarError(
            f"{len(empty)} of {count} masks are empty or show less than {_PERSON_MIN_PX} px of a person, "
            f"{paths[empty[0]].name} among them; the person must be white."
        )
    if empty:
        raise AvatarError(f"The mask {paths[empty[0]]} shows no one; leave out such frames ({len(empty)} of {count}).")
    sides = [max(np.ptp(np.flatnonzero(mask.any(axis=1))), np.ptp(np.flatnonzero(mask.any(axis=0)))) for mask in cuts]
    if float(np.median(sides)) < _PERSON_MIN_SIDE_PX:
        raise AvatarError(
            f"The person is {int(np.median(sides))} px tall in the median, too little to see; record from nearer."
        )
    two = [number for number, mask in enumerate(cuts) if _second_share(mask) > _SECOND_SHARE]
    if len(two) > _SECOND_FRAMES * count:
        raise AvatarError(
            f"{len(two)} of {count} masks show two people, {paths[two[0]].name} among them; "
            "an avatar is of one: leave the other out of the masks."
        )
    cut = sum(mask.is_cut_off for mask in masks)
    if cut > _CUT_FRAMES * count:
        raise AvatarError(
            f"The person is cut off at the bottom in {cut} of {count} frames: without feet no one can walk; "
            "record the whole person."
        )
    return [f"the person is cut off at the bottom in {cut} of {count} frames."] if cut else []


def _second_share(mask: BoolArray) -> float:
    """Size of the second largest piece of a mask relative to the largest."""
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8), connectivity=8)
    areas = np.sort(stats[1:, cv2.CC_STAT_AREA])
    return float(areas[-2] / areas[-1]) if len(areas) > 1 else 0.0


def _shrink(rgb: UInt8Array, mask: BoolArray, K_px: Float64Array, factor: float) -> tuple[UInt8Array, BoolArray]:
    """A frame made smaller; its intrinsics (3, 3) are changed."""
    height, width = mask.shape
    size = max(8, round(width * factor)), max(8, round(height * factor))
    K_px[0] *= size[0] / width
    K_px[1] *= size[1] / height
    small = cv2.resize(mask.astype(np.float32), size, interpolation=cv2.INTER_AREA)
    return np.asarray(cv2.resize(rgb, size, interpolation=cv2.INTER_AREA), dtype=np.uint8), np.asarray(small > 0.5)
