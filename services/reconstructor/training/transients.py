"""Transients: pixels that show what moved while a place was recorded, such as people who walk through.

Gaussians are trained on three quarters of the photos, at a small size, and drawn from where the other photos were
taken; four such folds predict every photo from photos without it. A prediction differs from its photo at transients,
and also where the scene is hard to draw: at edges, glass, and far away. There it differs in other photos of the same
place, too. So each difference is divided by the usual one, the median of those that other photos have at the point
that the prediction shows. Regions with large quotients are transients. A second round trains without the regions of
the first, and so predicts without traces of people.

Source: that large differences are transients is from RobustNeRF (Sabour et al., 2023), two limits for one region from
Canny (1986); folds and usual differences are ours.
"""

import json
import shutil
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from readygo.common.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from readygo.common.documents import read_json
from readygo.common.drawing.files import quantise, write_png
from readygo.common.errors import RunError
from readygo.common.files import write_whole
from readygo.services.reconstructor.training.config import DensityConfig, GaussiansConfig
from readygo.services.reconstructor.training.drawing import Leaves, draw, leaves_of, planes_of
from readygo.services.reconstructor.training.parameters import Gaussians
from readygo.services.reconstructor.training.photos import Photo, PhotoStore, Posed
from readygo.services.reconstructor.training.progress import Tell, TrainingProgress
from readygo.services.reconstructor.training.score import PREVIEWS, picture_name

SIDE_PX = 160
"""Longer side of the photos that are compared [px]."""
FOLDS = 4
ROUNDS = ((750, 0.25), (1500, 0.5))
"""Steps of the trainings of each round: at most so many, and at most this share of those of the training to come."""
GAUSSIANS_MAX = 20_000
_SMOOTH_PX = 1.5
"""Differences are smoothed with this standard deviation [px]."""
_FLOOR = 0.08
"""Is added to the usual difference (range 0..1): small ones are no transients where hardly anything differs."""
_STRONG, _WEAK = 1.5, 0.7
"""A region has quotients above the second, and some above the first."""
_STRONG_SHARE = 0.002
"""Share of the photo with quotients above the first that a region needs."""
_HOLE_SHARE = 0.02
"""Smaller holes belong to the region around them."""
_MARGIN_PX = 2
"""Regions are widened by this much [px]."""
_OTHERS, _OTHERS_MIN = 24, 3
"""Usual differences are medians over at most so many other photos; points in fewer than the least are no transients."""
_SHOWN_MIN = 0.02
"""Other photos show at least this share of a photo's points."""
_BEHIND = 1.15
"""A point is hidden in another photo if it is this much farther away than what is drawn there."""
_STRIDE, _COARSE_STRIDE = 2, 16
"""Usual differences are found at every so-manieth pixel; which photos show the same place, at every so-manieth."""
_FAR = 1e3
"""Depth where hardly anything is drawn, in median depths."""
_GAIN = 2.0
"""A photo is at most so many times as bright as its prediction, or as dark."""
_SHARE_MIN = 0.06
"""A smaller share of the pixels is not ignored: places that are hard to draw are taken for as many. In a video of the
showroom without people 3.9 % are, and to ignore them costs 0.5 dB; with two people who walk through it is 16 %."""
_PHOTOS_MIN = 8
"""Photos of fewer moments are not searched."""
FOLDER = "transients"
"""Where masks are kept, and their pictures among the previews."""
SHARE_MAX = 0.5
"""Where more of the pixels show what moves, usual differences are those of what moves: the place is not known."""
_REPORT, _WORK = "found.json", "work_"

Fit = Callable[[Posed, Path, GaussiansConfig, Tell], Gaussians]
"""Trains Gaussians on photos, in a folder in which the same call resumes."""


@dataclass(frozen=True, kw_only=True)
class Transients:
    """What was found."""

    masks: Path
    """Folder with NAME.png for every photo, in which 0 is a transient; smaller than the photos, of the same shape."""
    share: float
    """Mean share of the photos' pixels."""
    photos: int
    """Photos with any."""
    seconds: float
    """What the search took, since its last interruption."""

    @property
    def ignored(self) -> bool:
        """Whether they are more than what is taken for transients where nothing moves."""
        return self.share >= _SHARE_MIN

    @property
    def report(self) -> dict[str, Any]:
        """What the report of the training holds of them."""
        return {"share": self.share, "photos": self.photos, "ignored": self.ignored}

    @property
    def notes(self) -> list[str]:
        """What a user should know of them."""
        found = f"{100 * self.share:.1f} % of the pixels, in {self.photos} photos, look as if something moved there"
        if self.ignored:
            return [f"{found}; they are ignored, see previews/transients (transients = false uses them)"]
        if self.photos:
            few = "too few to tell from places that are hard to draw, so they are used"
            return [f"{found} (previews/transients): {few}; if people walk there, give masks"]
        return []


@dataclass(frozen=True, kw_only=True, eq=False)
class _Prediction:
    """A photo as the Gaussians of the other folds predict it."""

    K_px: Float64Array
    T_world_camera: Float64Array
    moment: int
    """Number of the moment that it shows: that of all views of one 360-degree image."""
    depth: Float32Array
    """Along the optical axis, `_FAR` median depths where hardly anything is drawn, shape (H, W)."""
    difference: Float32Array
    """From the photo, smoothed, range 0..1, shape (H, W)."""


def find_transients(
    posed: Posed, out: Path, settings: GaussiansConfig, identity: str, fit: Fit, progress: Tell
) -> Transients | None:
    """Find the transients of photos without masks; resume an interrupted search.

    Args:
        posed: The photos.
        out: Folder of the training. Masks go to `transients/masks`, pictures to `previews/transients`: each photo with
            transients, these in red.
        settings: Of the training that is to follow.
        identity: Stands for photos and settings: what was found for the same is not searched again.
        fit: How Gaussians are trained.
        progress: Is told how far the search is.

    Returns:
        None if the photos are too few to tell.

    Raises:
        ReadygoError: If photos cannot be read, or a training fails.
    """
    folder, began_s = out / FOLDER, time.monotonic()
    if len(np.unique(posed.moments)) < _PHOTOS_MIN:
        return None
    done = _found(folder, identity)
    if done is not None:
        return done
    work = _work_folder(folder, identity)
    small = _small_copies(posed, work / "photos")
    photos = PhotoStore(small, tuple(range(len(posed.views))), SIDE_PX, 1)
    steps = [max(1, min(most, int(share * settings.steps))) for most, share in ROUNDS]
    regions: list[BoolArray] = []
    for number, count in enumerate(steps):
        place = work / f"round_{number}"
        tell = _search_progress(progress, FOLDS * sum(steps[:number]), FOLDS * sum(steps))
        predictions = _predictions(small, photos, place, _settings(settings, count), fit, tell)
        regions = [region_of(p.difference, usual_difference(predictions, k)) for k, p in enumerate(predictions)]
        _write_masks(place / "masks", small.views.images, regions)
        small = replace(small, masks=place / "masks")
    _write_masks(folder / "masks", posed.views.images, regions)
    _write_previews(out / PREVIEWS / FOLDER, photos, posed.views.images, regions)
    found = {
        "identity": identity,
        "share": round(float(np.mean([region.mean() for region in regions])), 5),
        "photos": sum(bool(region.any()) for region in regions),
        "seconds": round(time.monotonic() - began_s, 2),
    }
    write_whole(folder / _REPORT, json.dumps(found, indent=1) + "\n", raises=RunError)
    shutil.rmtree(work)
    return _found(folder, identity)


def _work_folder(folder: Path, identity: str) -> Path:
    """Where a search works; what is left of searches of other photos or settings is removed, and their result."""
    work = folder / f"{_WORK}{identity}"
    for other in folder.glob(f"{_WORK}*"):
        if other != work:
            shutil.rmtree(other)
    (folder / _REPORT).unlink(missing_ok=True)
    return work


def _found(folder: Path, identity: str) -> Transients | None:
    """What a search has found; None without one.

    Raises:
        RunError: If most of the photos' pixels show what moves.
    """
    try:
        found = read_json(folder / _REPORT)
    except (OSError, ValueError):
        return None
    if not isinstance(found, dict) or found.get("identity") != identity:
        return None
    if found["share"] > SHARE_MAX:
        raise RunError(
            f"{100 * found['share']:.0f} % of the pixels look as if something moved there: too little of the place is "
            "shown. Film when fewer people are there, or give masks; see previews/transients (transients = false uses "
            "all pixels)."
        )
    return Transients(masks=folder / "masks", share=found["share"], photos=found["photos"], seconds=found["seconds"])


def _settings(settings: GaussiansConfig, steps: int) -> GaussiansConfig:
    """Settings of the trainings of a round."""
    return GaussiansConfig(
        steps=steps,
        side_max_px=SIDE_PX,
        hold_out=0,
        sh_degree=min(1, settings.sh_degree),
        seed=settings.seed,
        density=DensityConfig(method="mcmc", count_max=GAUSSIANS_MAX),
    )


def _search_progress(progress: Tell, before: int, steps: int) -> Tell:
    """Tells the progress of a round's trainings, which follow each other, as that of the whole search."""
    done, last = before, 0

    def tell(at: TrainingProgress) -> None:
        nonlocal done, last
        done, last = done + (last if at.step < last else 0), at.step
        progress(replace(at, step=done + at.step, steps=steps, searches=True))

    return tell


def _small_copies(posed: Posed, folder: Path) -> Posed:
    """The same photos as small files: they are read many times."""
    for number, name in enumerate(posed.views.images):
        path = folder / f"{name}.png"
        if not path.is_file():
            write_png(path, PhotoStore(posed, (number,), SIDE_PX, 1).pixels(number))
    views = replace(posed.views, images=tuple(f"{name}.png" for name in posed.views.images))
    return replace(posed, views=views, folder=folder)


def _predictions(
    small: Posed, photos: PhotoStore, folder: Path, settings: GaussiansConfig, fit: Fit, tell: Tell
) -> list[_Prediction]:
    """All photos as those of other folds predict them."""
    moments, found = small.moments, dict[int, _Prediction]()
    for fold in range(FOLDS):
        held = moments % FOLDS == fold
        others = small.select(np.flatnonzero(~held).tolist())
        leaves = leaves_of(fit(others, folder / f"fold_{fold}", settings, tell))
        for number in np.flatnonzero(held).tolist():
            found[number] = _predict(leaves, photos[number], settings.sh_degree, int(moments[number]))
    return [found[number] for number in range(len(moments))]


def _predict(leaves: Leaves, photo: Photo, sh_degree: int, moment: int) -> _Prediction:
    drawn = draw(leaves, photo, sh_degree)
    difference = np.abs(matched(planes_of(drawn), photo.rgb) - photo.rgb).mean(axis=0)
    depth, alpha = drawn.depth_m.detach().numpy(), drawn.alpha.detach().numpy()
    there = alpha > 0.5
    far = _FAR * (float(np.median(depth[there])) if there.any() else 1.0)
    return _Prediction(
        K_px=photo.K_px,
        T_world_camera=photo.T_world_camera,
        moment=moment,
        depth=np.where(there, depth, far).astype(np.float32),
        difference=cv2.GaussianBlur(difference.astype(np.float32), (0, 0), _SMOOTH_PX),
    )


def matched(image: Float32Array, photo: Float32Array) -> Float32Array:
    """An image with the gains and offsets of the colours that fit the best 70 % of a photo best, shape (3, H, W)."""
    counts = np.ones(photo.shape[1:], dtype=np.bool_)
    shown = image
    for _ in range(3):
        shown = np.empty_like(image)
        for channel in range(3):
            x, y = image[channel][counts].astype(np.float64), photo[channel][counts].astype(np.float64)
            spread = float(x.var())
            gain = float(((x - x.mean()) * (y - y.mean())).mean() / spread) if spread > 1e-6 else 1.0
            gain = min(max(gain, 1.0 / _GAIN), _GAIN)
            shown[channel] = gain * image[channel] + (y.mean() - gain * x.mean())
        shown = np.clip(shown, 0.0, 1.0)
        difference = np.abs(shown - photo).mean(axis=0)
        counts = difference <= np.quantile(difference, 0.7)
    return shown


def usual_difference(predictions: Sequence[_Prediction], number: int) -> Float32Array:
    """Median difference of other photos at the points that a photo shows; inf where too few show them, shape (H, W)."""
    own = predictions[number]
    height, width = own.depth.shape
    others = _others_of(predictions, number)
    points = _points(own, _STRIDE)
    found = np.stack([_difference_at(predictions[other], points) for other in others] or [np.full(len(points), np.inf)])
    found.sort(axis=0)
    counts = np.isfinite(found).sum(axis=0)
    median = np.take_along_axis(found, np.maximum(counts - 1, 0)[None] // 2, axis=0)[0]
    usual = np.where(counts >= _OTHERS_MIN, median, np.inf).astype(np.float32)
    grid = usual.reshape(len(range(0, height, _STRIDE)), len(range(0, width, _STRIDE)))
    return np.repeat(np.repeat(grid, _STRIDE, axis=0), _STRIDE, axis=1)[:height, :width]


def _others_of(predictions: Sequence[_Prediction], number: int) -> list[int]:
    """Photos of other moments that show what a photo shows, spread evenly over all of them."""
    own = predictions[number]
    points = _points(own, _COARSE_STRIDE)
    shares = [
        0.0 if other.moment == own.moment else np.isfinite(_project(other, points)[0]).mean() for other in predictions
    ]
    showing = [other for other, share in enumerate(shares) if share >= _SHOWN_MIN]
    if len(showing) <= _OTHERS:
        return showing
    return [showing[k] for k in np.linspace(0, len(showing) - 1, _OTHERS).round().astype(np.int64)]


def _points(prediction: _Prediction, stride: int) -> Float64Array:
    """Points of the world that a prediction shows at every so-manieth pixel, shape (n, 3)."""
    depth = prediction.depth[::stride, ::stride].astype(np.float64)
    v, u = np.mgrid[: prediction.depth.shape[0] : stride, : prediction.depth.shape[1] : stride] + 0.5
    K, T = prediction.K_px, prediction.T_world_camera
    rays = np.stack([(u - K[0, 2]) / K[0, 0], (v - K[1, 2]) / K[1, 1], np.ones_like(u)], axis=-1)
    points: Float64Array = (rays * depth[..., None]).reshape(-1, 3) @ T[:3, :3].T + T[:3, 3]
    return points


def _project(prediction: _Prediction, points: Float64Array) -> tuple[Float64Array, Int64Array, Int64Array]:
    """Depths of points in a photo, inf where it does not show them, and their rows and columns, each of shape (n,)."""
    K, T = prediction.K_px, prediction.T_world_camera
    seen = (points - T[:3, 3]) @ T[:3, :3]
    depth = seen[:, 2]
    before = depth > 1e-6
    ahead = np.where(before, depth, 1.0)
    column = np.floor(K[0, 0] * seen[:, 0] / ahead + K[0, 2])
    row = np.floor(K[1, 1] * seen[:, 1] / ahead + K[1, 2])
    height, width = prediction.depth.shape
    inside = before & (column >= 0) & (column < width) & (row >= 0) & (row < height)
    rows, columns = np.where(inside, row, 0).astype(np.int64), np.where(inside, column, 0).astype(np.int64)
    return np.where(inside, depth, np.inf), rows, columns


def _difference_at(prediction: _Prediction, points: Float64Array) -> Float64Array:
    """Differences of a photo at points of the world, inf where it does not show them, shape (n,)."""
    depth, rows, columns = _project(prediction, points)
    visible = depth < _BEHIND * prediction.depth[rows, columns]
    return np.where(visible, prediction.difference[rows, columns], np.inf)


def region_of(difference: Float32Array, usual: Float32Array) -> BoolArray:
    """True at the transients of a photo, shape (H, W).

    Args:
        difference: From its prediction, smoothed, shape (H, W).
        usual: Of other photos at the same points; inf where that is not known.
    """
    quotient = difference / (usual + np.float32(_FLOOR))
    square = np.ones((3, 3), dtype=np.uint8)
    weak = cv2.morphologyEx((quotient > _WEAK).astype(np.uint8), cv2.MORPH_CLOSE, square)
    weak = cv2.morphologyEx(weak, cv2.MORPH_OPEN, square)
    count, labels = cv2.connectedComponents(weak, connectivity=8)
    strong = np.bincount(labels[quotient > _STRONG], minlength=count)
    chosen = strong >= _STRONG_SHARE * difference.size
    chosen[0] = False
    region = _without_holes(chosen[labels])
    disc = cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (2 * _MARGIN_PX + 1, 2 * _MARGIN_PX + 1))
    return cv2.dilate(region.astype(np.uint8), disc).astype(np.bool_)


def _without_holes(region: BoolArray) -> BoolArray:
    """A region with its small holes that do not reach the border."""
    _, labels, stats, _ = cv2.connectedComponentsWithStats((~region).astype(np.uint8), connectivity=4)
    left, top, width, height, area = stats.T
    rows, columns = region.shape
    inside = (left > 0) & (top > 0) & (left + width < columns) & (top + height < rows)
    filled = inside & (area < _HOLE_SHARE * region.size)
    filled[0] = False
    without: BoolArray = region | filled[labels]
    return without


def _write_masks(folder: Path, names: Sequence[str], regions: Sequence[BoolArray]) -> None:
    for name, region in zip(names, regions, strict=True):
        mask = cv2.imencode(".png", np.where(region, 0, 255).astype(np.uint8))[1]
        write_whole(folder / f"{name}.png", mask.tobytes(), raises=RunError)


def _write_previews(folder: Path, photos: PhotoStore, names: Sequence[str], regions: Sequence[BoolArray]) -> None:
    shutil.rmtree(folder, ignore_errors=True)
    for number, (name, region) in enumerate(zip(names, regions, strict=True)):
        if region.any():
            planes = photos[number].rgb.copy()
            planes[0][region] = 0.5 * planes[0][region] + 0.5
            planes[1:, region] *= 0.5
            write_png(folder / picture_name(name), quantise(planes))
