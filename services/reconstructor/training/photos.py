"""The photos of a posed COLMAP model: which there are, where they were taken from, and their pixels at some size."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array, UInt8Array, UInt16Array
from readygo.common.camera.captured import CapturedViews
from readygo.common.errors import SceneError
from readygo.common.images.encoded import read_pixels
from readygo.services.reconstructor.frames.depths import FOLDER as DEPTHS
from readygo.services.reconstructor.frames.depths import STEP_M, read_steps
from readygo.services.reconstructor.frames.masks import FOLDER as MASKS
from readygo.services.reconstructor.frames.masks import read_mask, shrink_mask
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.poses import colmap, undistortion
from readygo.services.reconstructor.poses.config import PosesConfig
from readygo.services.reconstructor.similarity import Similarity
from readygo.services.reconstructor.stages import Stages, code_digest, identity_of

KEPT_BYTES = 2 << 30
"""Photos that need more than this are read from disk each time that they are used."""
BRIGHTNESS = np.float32(1 / 255)
"""Brightness of one step of a pixel's value."""
_POINTS_MIN, _VIEWS_MIN = 30, 3
_EXTENT = 1.1
"""The scene's extent is this times the largest distance of a camera from their mean."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Posed:
    """A posed COLMAP model with pinhole cameras."""

    views: CapturedViews
    folder: Path
    """Folder of the images."""
    points_m: Float64Array
    """Points of the map [m], shape (P, 3)."""
    points_rgb: UInt8Array
    """Colours of the points, shape (P, 3)."""
    seen: Int64Array
    """Sightings of points: rows of the numbers of view and point, shape (M, 2)."""
    moments: Int64Array
    """Number of the moment that each view shows, see `colmap.moment_numbers`, shape (V,)."""
    masks: Path | None = None
    """Folder of the images' masks, NAME.png, in which 0 is ignored; None without any."""
    depths: Path | None = None
    """Folder of the images' depth images, NAME.png, see `read_steps`; some may be missing. None without any."""

    @property
    def extent_m(self) -> float:
        """How far the cameras are spread [m]."""
        places = self.views.T_world_camera[:, :3, 3]
        return _EXTENT * float(np.linalg.norm(places - places.mean(axis=0), axis=1).max())

    @property
    def depth_m(self) -> float:
        """Median depth of the points in the views that see them [m]; 0 without any sighting."""
        if not len(self.seen):
            return 0.0
        T = self.views.T_world_camera[self.seen[:, 0]]
        return float(np.median(((self.points_m[self.seen[:, 1]] - T[:, :3, 3]) * T[:, :3, 2]).sum(axis=1)))

    def select(self, numbers: Sequence[int]) -> "Posed":
        """The model with some of its views, in this order, and all of its points."""
        rows = np.full(len(self.views), -1, dtype=np.int64)
        rows[list(numbers)] = np.arange(len(numbers))
        seen = np.stack([rows[self.seen[:, 0]], self.seen[:, 1]], axis=1)
        moments = self.moments[list(numbers)]
        return replace(self, views=self.views.select(numbers), seen=seen[seen[:, 0] >= 0], moments=moments)


@dataclass(frozen=True, kw_only=True, eq=False)
class Photo:
    """A photo at the size that it is trained or measured at."""

    rgb: Float32Array
    """Colours in 0..1, shape (3, H, W)."""
    K_px: Float64Array
    T_world_camera: Float64Array
    mask: BoolArray | None = None
    """True where the photo counts, shape (H, W); None where all of it does."""
    depth_m: Float32Array | None = None
    """Depths that the device measured, 0 where it did not, shape (H, W); None without any."""


def open_posed(folder: Path, undistorted: Path) -> Posed:
    """Read a posed model.

    Args:
        folder: With `images/` and `sparse/0/`, `sparse/` or the model's files.
        undistorted: Where images of other than pinhole cameras are written undistorted.

    Raises:
        SceneError: If it cannot be used.
    """
    model, images, masks, depths = model_of(folder), folder / "images", folder / MASKS, folder / DEPTHS
    if not colmap.is_pinhole(model):
        _undistort(model, images, masks, depths, undistorted)
        model, images = undistorted / "sparse" / "0", undistorted / "images"
        masks, depths = undistorted / MASKS, undistorted / DEPTHS
    views, found = colmap.pinhole_views(model), colmap.read_map(model)
    _check(folder, images, views, found)
    if masks.is_dir():
        _check_there(masks, [f"{name}.png" for name in views.images], "masks")
    posed = Posed(
        views=views,
        folder=images,
        points_m=found.points,
        points_rgb=found.points_rgb,
        seen=found.seen,
        moments=colmap.moment_numbers(model),
        masks=masks if masks.is_dir() else None,
        depths=depths if depths.is_dir() else None,
    )
    if posed.extent_m <= 0:
        raise SceneError(f"All cameras of {folder} stand in one place; Gaussians need views from several.")
    return posed


def model_of(folder: Path) -> Path:
    """The COLMAP model of a folder that has its images as well.

    Raises:
        SceneError: If one of them is missing.
    """
    model = colmap.find_model(folder)
    if model is None or not (folder / "images").is_dir():
        raise SceneError(f"{folder} needs images/ and a COLMAP model in sparse/0/; run `readygo scene poses` first.")
    return model


def _undistort(model: Path, images: Path, masks: Path, depths: Path, undistorted: Path) -> None:
    """Undistort images, masks and depths into a folder unless it is there already, made of the same files."""
    names = colmap.image_names(model)
    _check_there(images, names, "images")

    def make(folder: Path) -> dict[str, bool]:
        same = Similarity(scale=1.0, R=np.eye(3), t=np.zeros(3))
        undistortion.write_undistorted(model, images, folder, same, PosesConfig())
        if masks.is_dir():
            undistortion.write_undistorted_masks(model, masks, folder)
        undistortion.write_undistorted_depths(model, depths, folder, 1.0)
        return {"masks": masks.is_dir()}

    files = [*colmap.model_files(model), *(images / name for name in names)]
    files += [kind / f"{name}.png" for kind in (masks, depths) for name in names]
    settings = {"model": str(model.resolve()), "files": identity_of(files), "masks": masks.is_dir()}
    undistorted.parent.mkdir(parents=True, exist_ok=True)
    Stages(undistorted.parent, lambda _: None).run(undistorted.name, settings, make, code=code_digest("poses"))


def _check(folder: Path, images: Path, views: CapturedViews, found: PosedImages) -> None:
    if len(views) < _VIEWS_MIN or len(found.points) < _POINTS_MIN:
        raise SceneError(
            f"{folder} has {len(views)} images with poses and {len(found.points)} points; "
            f"Gaussians need at least {_VIEWS_MIN} and {_POINTS_MIN}."
        )
    _check_there(images, views.images, "images")


def _check_there(folder: Path, names: Sequence[str], what: str) -> None:
    missing = [name for name in names if not (folder / name).is_file()]
    if missing:
        raise SceneError(f"{folder} lacks {len(missing)} {what} of the model, {missing[0]} among them.")


def size_px(posed: Posed, number: int, side_max_px: int, fraction: int) -> tuple[int, int]:
    """Width and height that a photo is made smaller to: its longer side at most so long, and then divided."""
    width, height = (int(side) for side in posed.views.sizes_px[number])
    scale = min(1.0, side_max_px / max(width, height)) / fraction
    return max(16, round(width * scale)), max(16, round(height * scale))


class PhotoStore:
    """Photos at one size, kept in memory where they fit."""

    def __init__(self, posed: Posed, numbers: tuple[int, ...], side_max_px: int, fraction: int) -> None:
        """Read the photos.

        Args:
            posed: The model.
            numbers: Of the views that are wanted.
            side_max_px: Larger ones are made smaller.
            fraction: And then by this.

        Raises:
            SceneError: If one cannot be read, or has another shape than its camera.
        """
        self._posed, self._side_max_px, self._fraction = posed, side_max_px, fraction
        self._numbers = numbers
        sizes = [size_px(posed, number, side_max_px, fraction) for number in numbers]
        keeps = bytes_of(posed) * sum(width * height for width, height in sizes) <= KEPT_BYTES
        self._kept = {number: self._read(number) for number in numbers} if keeps else {}
        self._kept_masks = {number: self._read_mask(number) for number in numbers} if keeps else {}
        self._kept_depths = {number: self._read_depth(number) for number in numbers} if keeps else {}

    @property
    def keeps(self) -> bool:
        """Whether the photos fit into memory."""
        return bool(self._kept)

    def pixels(self, number: int) -> UInt8Array:
        """The photo of a view as it is read, shape (H, W, 3)."""
        pixels = self._kept.get(number)
        return self._read(number) if pixels is None else pixels

    def mask(self, number: int) -> BoolArray | None:
        """True where the photo of a view counts, shape (H, W); None where all of it does."""
        return self._kept_masks[number] if number in self._kept_masks else self._read_mask(number)

    def depth_m(self, number: int) -> Float32Array | None:
        """Depths of a view that the device measured, 0 where it did not, shape (H, W); None without any."""
        steps = self._kept_depths[number] if number in self._kept_depths else self._read_depth(number)
        return None if steps is None else np.float32(STEP_M) * steps

    def camera(self, number: int, size_px: tuple[int, int]) -> tuple[Float64Array, Float64Array]:
        """`K_px` of a view whose photo has so many rows and columns, and `T_world_camera`."""
        views = self._posed.views
        K = views.K_px[number].copy()
        K[:2] *= (np.array(size_px[::-1]) / views.sizes_px[number])[:, None]
        return K, views.T_world_camera[number]

    def __getitem__(self, number: int) -> Photo:
        """The photo of a view."""
        pixels = self.pixels(number)
        K, T = self.camera(number, pixels.shape[:2])
        planes = np.empty((3, *pixels.shape[:2]), dtype=np.float32)
        for channel in range(3):
            np.multiply(pixels[:, :, channel], BRIGHTNESS, out=planes[channel])
        return Photo(rgb=planes, K_px=K, T_world_camera=T, mask=self.mask(number), depth_m=self.depth_m(number))

    def items(self) -> Iterator[tuple[str, Photo]]:
        """Names of the images, and their photos."""
        return ((self._posed.views.images[number], self[number]) for number in self._numbers)

    def _read(self, number: int) -> UInt8Array:
        """Read a view's pixels, shape (H, W, 3)."""
        path = self._posed.folder / self._posed.views.images[number]
        # Poses are of the pixels as they lie in the file: EXIF does not turn them.
        pixels = read_pixels(path, cv2.IMREAD_COLOR | cv2.IMREAD_IGNORE_ORIENTATION)
        if pixels is None:
            raise SceneError(f"{path} cannot be read as an image.")
        width, height = self._posed.views.sizes_px[number]
        if abs(pixels.shape[1] * height - pixels.shape[0] * width) > 2 * max(width, height):
            raise SceneError(f"{path} is {pixels.shape[1]}x{pixels.shape[0]} px, its camera {width}x{height} px.")
        size = size_px(self._posed, number, self._side_max_px, self._fraction)
        small = cv2.resize(pixels, size, interpolation=cv2.INTER_AREA) if size != pixels.shape[1::-1] else pixels
        return np.ascontiguousarray(small[:, :, ::-1])

    def _read_mask(self, number: int) -> BoolArray | None:
        """Read a view's mask, shape (H, W)."""
        if self._posed.masks is None:
            return None
        path = self._posed.masks / f"{self._posed.views.images[number]}.png"
        mask = read_mask(path)
        width, height = self._posed.views.sizes_px[number]
        if mask is None or abs(mask.shape[1] * height - mask.shape[0] * width) > 2 * max(width, height):
            there = "no mask" if mask is None else f"{mask.shape[1]}x{mask.shape[0]} px"
            raise SceneError(f"{path} is {there}, its camera {width}x{height} px.")
        return shrink_mask(mask, size_px(self._posed, number, self._side_max_px, self._fraction)) > 0

    def _read_depth(self, number: int) -> UInt16Array | None:
        """Read a view's depths in steps, shape (H, W)."""
        if self._posed.depths is None:
            return None
        steps = read_steps(self._posed.depths / f"{self._posed.views.images[number]}.png")
        if steps is None:
            return None
        size = size_px(self._posed, number, self._side_max_px, self._fraction)
        return np.asarray(cv2.resize(steps, size, interpolation=cv2.INTER_NEAREST_EXACT), dtype=np.uint16)


def bytes_of(posed: Posed) -> int:
    """Memory of a pixel that is kept: its colours, its mask, and its depth."""
    return 3 + (posed.masks is not None) + 2 * (posed.depths is not None)


def split_views(moments: Sequence[int] | Int64Array, hold_out: int) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Numbers of the views to train on, and of those that are held out.

    Args:
        moments: Number of the moment that each view shows, counted from 0.
        hold_out: The views of every so-manieth moment are held out, from the first on; 0: none.
    """
    held = tuple(number for number, moment in enumerate(moments) if hold_out and moment % hold_out == 0)
    return tuple(number for number in range(len(moments)) if number not in held), held


def views_by_moment(moments: Int64Array, numbers: Sequence[int]) -> list[list[int]]:
    """Some views, those of each moment together.

    Args:
        moments: Number of the moment that each view shows.
        numbers: The views.
    """
    groups: dict[int, list[int]] = {}
    for number in numbers:
        groups.setdefault(int(moments[number]), []).append(number)
    return list(groups.values())
