"""Metres per unit of a map, from markers of known size or lengths that a user measured."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.errors import SceneError
from readygo.services.reconstructor.metric.markers import MarkerSighting
from readygo.services.reconstructor.metric.triangulate import triangulate
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.similarity import Similarity, umeyama

VIEWS_MIN = 3
"""Fewer images say too little of a marker's corners."""
_BOOTSTRAPS = 100
_SQUARE_TOLERANCE = 0.05
"""Corners that are farther off a square than this share of its side are no marker's."""
_SIGMA_MAX = 0.05
"""A scale that is known worse is none."""
_AGREE = 0.01
"""Markers may differ by this beyond their intervals: printers and rulers do."""
TWO_SIDED_95 = 1.96


@dataclass(frozen=True, kw_only=True, eq=False)
class MarkerMeasure:
    """A marker in the map."""

    marker: int
    corners: Float64Array
    """Corners in units of the map, shape (4, 3)."""
    map_from_marker: Similarity
    """From metres in the marker's frame (x right, y up, z out of the paper) to the map."""
    metres_per_unit: float
    sigma: float
    """Standard deviation of that, relative; of corners and poses, not of the printed size."""
    views: int
    residual_px: float
    """Root mean square of the distance between corners where they were seen and where they should be [px]."""
    square_error: float
    """Root mean square of the corners' distance to the fitted square, as share of its side."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Scale:
    """Metres per unit of the map, with its interval of 95 %."""

    metres_per_unit: float
    sigma: float
    """Relative; None is known of a scale that was given: NaN."""
    source: str
    """Source of the scale: markers, length, given, or none."""
    markers: tuple[int, ...] = ()
    """Markers that tell it."""
    left_out: tuple[str, ...] = ()
    """Markers that were not used, and why."""
    drift: float = 0.0
    """Relative standard deviation of the map's size beside what told the scale, see `drift.py`."""

    @property
    def half_interval(self) -> float:
        """Half of the interval, relative."""
        return TWO_SIDED_95 * math.hypot(self.sigma, self.drift)

    @property
    def interval(self) -> tuple[float, float]:
        """Bounds of 95 % of metres per unit."""
        half = self.half_interval * self.metres_per_unit
        return self.metres_per_unit - half, self.metres_per_unit + half


def square_corners_m(size_m: float) -> Float64Array:
    """Corners of a marker in its own frame, in the order of `MarkerSighting`, shape (4, 3) [m]."""
    half = 0.5 * size_m
    return np.array([[-half, half, 0.0], [half, half, 0.0], [half, -half, 0.0], [-half, -half, 0.0]])


def measure_marker(images: PosedImages, sightings: Sequence[MarkerSighting], size_m: float) -> MarkerMeasure:
    """A marker's corners and what they say of the map's scale.

    The spread over resampled images (bootstrap) holds the errors of corners and of poses together; where the corners'
    own noise makes more of it, that counts.

    Args:
        images: The map.
        sightings: Of one marker; those in images without a pose are ignored.
        size_m: Printed side [m].

    Raises:
        SceneError: If the marker cannot be measured; the message says why.
    """
    name = f"marker {sightings[0].marker}"
    views, rays = _marker_views(images, sightings)
    if len(views) < VIEWS_MIN:
        raise SceneError(f"{name} is in {len(views)} images with a pose; {VIEWS_MIN} are needed")
    try:
        corners, residuals_px, covariances = _corners(images, views, rays, np.arange(len(views)))
    except (ValueError, np.linalg.LinAlgError) as error:
        raise SceneError(f"{name} cannot be placed: {error}") from error
    fit = umeyama(square_corners_m(size_m), corners)
    off = np.linalg.norm(fit.apply(square_corners_m(size_m)) - corners, axis=1) / (fit.scale * size_m)
    noise_px = max(float(np.sqrt((residuals_px**2).mean() / 2.0)), 0.02)
    # A side's two corners move along it; four sides say it four times.
    along = float(np.trace(covariances.mean(axis=0)) / 3.0)
    by_noise = noise_px * np.sqrt(2.0 * along / 4.0) / (fit.scale * size_m)
    measure = MarkerMeasure(
        marker=sightings[0].marker,
        corners=corners,
        map_from_marker=fit,
        metres_per_unit=1.0 / fit.scale,
        sigma=max(float(by_noise), _bootstrap_sigma(images, views, rays, size_m)),
        views=len(views),
        residual_px=float(np.sqrt((residuals_px**2).mean())),
        square_error=float(np.sqrt((off**2).mean())),
    )
    _refuse_doubtful(measure)
    return measure


def marker_side(images: PosedImages, sightings: Sequence[MarkerSighting]) -> float:
    """Side of a marker in units of the map; its sightings in images without a pose are ignored."""
    views, rays = _marker_views(images, sightings)
    return umeyama(square_corners_m(1.0), _corners(images, views, rays, np.arange(len(views)))[0]).scale


def _marker_views(images: PosedImages, sightings: Sequence[MarkerSighting]) -> tuple[Int64Array, Float64Array]:
    """Which images with a pose see a marker, shape (V,), and where its corners are at depth 1, shape (V, 4, 2)."""
    index = {name: number for number, name in enumerate(images.names)}
    seen = [sighting for sighting in sightings if sighting.image in index]
    views = np.array([index[sighting.image] for sighting in seen], dtype=np.int64)
    rays = [images.rays(view, sighting.corners_px) for view, sighting in zip(views.tolist(), seen, strict=True)]
    return views, np.array(rays).reshape(-1, 4, 2)


def _corners(
    images: PosedImages, views: Int64Array, rays: Float64Array, chosen: Int64Array
) -> tuple[Float64Array, Float64Array, Float64Array]:
    """Corners (4, 3), residuals (4, V) and covariances (4, 3, 3) of the chosen sightings."""
    poses, focal_px = images.T_world_camera[views[chosen]], images.focal_px[views[chosen]]
    found = [triangulate(rays[chosen, corner], poses, focal_px) for corner in range(4)]
    return (
        np.stack([each.point for each in found]),
        np.stack([each.residuals_px for each in found]),
        np.stack([each.covariance for each in found]),
    )


def _bootstrap_sigma(images: PosedImages, views: Int64Array, rays: Float64Array, size_m: float) -> float:
    """Relative spread of the scale over draws of images with replacement."""
    rng = np.random.default_rng(0)
    logs = []
    for _ in range(_BOOTSTRAPS):
        chosen = rng.integers(len(views), size=len(views))
        if len(set(chosen.tolist())) < 2:
            continue
        try:
            corners = _corners(images, views, rays, chosen)[0]
        except (ValueError, np.linalg.LinAlgError):
            continue
        logs.append(np.log(umeyama(square_corners_m(size_m), corners).scale))
    # Quartiles: a draw of nearly parallel views may be anywhere.
    low, high = np.percentile(logs, [25.0, 75.0]) if logs else (0.0, np.inf)
    return float((high - low) / 1.349)


def _refuse_doubtful(measure: MarkerMeasure) -> None:
    name = f"marker {measure.marker}"
    if measure.square_error > _SQUARE_TOLERANCE:
        raise SceneError(
            f"{name} is no square in the map (corners are off by {100 * measure.square_error:.0f} % of its side): "
            "it moved, or there are two with this id"
        )
    if not measure.sigma <= _SIGMA_MAX:
        raise SceneError(
            f"{name} gives the scale to +-{100 * TWO_SIDED_95 * measure.sigma:.0f} % only: film it from several sides"
        )


def scale_of_markers(measures: Sequence[MarkerMeasure], size_m: float, printed_sigma_m: float) -> Scale:
    """The mean of what markers of the same size say, weighted by how well each is known.

    Where a majority agrees the others are left out and named. Two that differ are refused.

    Args:
        measures: One or more.
        size_m: Printed side [m].
        printed_sigma_m: Standard deviation of the side that was measured with a ruler [m].

    Raises:
        SceneError: If markers contradict each other.
    """
    logs = np.log([measure.metres_per_unit for measure in measures])
    sigmas = np.array([measure.sigma for measure in measures])
    apart = np.abs(logs[:, None] - logs[None, :]) > 3.0 * np.hypot(sigmas[:, None], sigmas[None, :]) + _AGREE
    friends = (~apart).sum(axis=1)
    best = int(np.argmax(friends))
    if 2 * int(friends[best]) <= len(measures) and len(measures) > 1:
        said = "; ".join(f"marker {m.marker}: {m.metres_per_unit:.4g} m per unit +-{_percent(m)}" for m in measures)
        raise SceneError(
            f"Markers contradict each other: {said}, each taken as {size_m:g} m wide. Measure them, and name the one "
            "that has this size with --metric.marker-ids."
        )
    kept = ~apart[best]
    weights = kept / np.maximum(sigmas, 1e-6) ** 2
    mean = float((weights * logs).sum() / weights.sum())
    # Poses of one map are wrong together: more markers do not make it better than the best of them.
    sigma = float(np.hypot(sigmas[kept].min(), printed_sigma_m / size_m))
    used = tuple(m.marker for m, good in zip(measures, kept, strict=True) if good)
    left_out = tuple(
        f"marker {m.marker} says {100 * (np.exp(log - mean) - 1):+.1f} %"
        for m, log, good in zip(measures, logs, kept, strict=True)
        if not good
    )
    plural = "s" if int(kept.sum()) > 1 else ""
    source = f"marker{plural} {', '.join(map(str, used))} of {size_m:g} m"
    return Scale(metres_per_unit=float(np.exp(mean)), sigma=sigma, source=source, markers=used, left_out=left_out)


def _percent(measure: MarkerMeasure) -> str:
    return f"{100 * TWO_SIDED_95 * measure.sigma:.1f} %"
