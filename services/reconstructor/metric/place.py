"""From a map in arbitrary units to metres, z up, with z = 0 on the floor."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.metric.config import MetricConfig
from readygo.services.reconstructor.metric.lengths import KnownLength, measured_length
from readygo.services.reconstructor.metric.markers import MarkerSighting
from readygo.services.reconstructor.metric.scale import (
    TWO_SIDED_95,
    MarkerMeasure,
    Scale,
    marker_side,
    measure_marker,
    scale_of_markers,
)
from readygo.services.reconstructor.metric.up import (
    FLOOR_MARKER_MAX_DEG,
    HELD_ERROR_DEG,
    LEAN_MIN_DEG,
    Floor,
    floor_of_points,
    held_up,
    lean_deg,
    world_from_map,
)
from readygo.services.reconstructor.posed import PosedImages
from readygo.services.reconstructor.similarity import Similarity

_MARKER_SIGMA_M = 0.0002
"""Standard deviation of a marker's printed side, as measured with a ruler [m]."""
_CHECK_TOLERANCE = 0.02
"""A second length may differ by this share beyond the intervals before it is called wrong."""
_HANDHELD_M = (0.15, 3.5)
"""Heights at which people hold cameras [m]; others make a marker's size doubtful."""


NO_SCALE = (
    "Nothing tells the scale: give --marker-size-m for a printed marker (`readygo marker` makes one), --length between "
    "two points, or --scale."
)


@dataclass(frozen=True, kw_only=True, eq=False)
class Device:
    """What a device that filmed measured itself."""

    name: str = ""
    metric: bool = False
    """Whether it tells the scale of its poses."""
    metres_per_unit: float = 1.0
    """Of its poses, where it tells their scale."""
    up: Float64Array | None = None
    """Where up is in the frame of its poses, a unit vector, shape (3,); None if it does not tell."""


_NO_DEVICE = Device()
_DRIFT_UNKNOWN = "the interval of the scale is that of what told it alone: how far the map is bent cannot be told"


def scale_is_told(config: MetricConfig) -> bool:
    """Whether the settings tell the scale."""
    return bool(config.marker_size_m or config.lengths or config.scale)


@dataclass(frozen=True, kw_only=True, eq=False)
class Placement:
    """Scale, pose and floor of a map in the world."""

    world_from_map: Similarity
    scale: Scale
    floor: Floor
    markers: tuple[MarkerMeasure, ...]
    warnings: tuple[str, ...]


@dataclass(frozen=True, kw_only=True, eq=False)
class Ruler:
    """What told the scale of a map."""

    measure: Callable[[PosedImages], float]
    """Length of the ruler in units of a map of the same images."""
    images: frozenset[str]
    """Images that show the ruler."""


FindDrift = Callable[[Ruler], float | None]
"""Relative standard deviation of the map's size beside a ruler; None if it cannot be told."""


def place_map(
    images: PosedImages,
    sightings: Sequence[MarkerSighting],
    lengths: Sequence[KnownLength],
    config: MetricConfig,
    device: Device = _NO_DEVICE,
    find_drift: FindDrift | None = None,
) -> Placement:
    """Find scale, up and floor of a map.

    Args:
        images: The map.
        sightings: Of markers.
        lengths: What `config.lengths` says, in pixels of these images.
        config: What makes the map metric.
        device: What the device measured; its scale is taken where nothing else tells one, and checked by what does.
        find_drift: Tells the map's drift, which the scale's interval has a share of; None takes none.

    Raises:
        ConfigError: If nothing tells the scale.
        SceneError: If what tells it cannot be measured, or contradicts itself.
    """
    measures, warnings = _measured_markers(images, sightings, config)
    scale = _scale(images, measures, lengths, config, device)
    kept = [measure for measure in measures if measure.marker in scale.markers]
    scale, unknown = _with_drift(scale, ruler_of(kept, sightings, lengths), find_drift)
    more = [*scale.left_out, *_length_checks(images, lengths if measures else lengths[1:], scale)]
    if device.metric and scale_is_told(config):
        off = 100.0 * (scale.metres_per_unit / device.metres_per_unit - 1.0)
        more.append(f"check: lengths are {off:+.1f} % longer by {scale.source} than by the device ({device.name})")
    up = held_up(images.T_world_camera) if device.up is None else device.up
    floor, marker, others = _floor(images, kept, config, up)
    origin = images.T_world_camera[0, :3, 3] if marker is None else marker.corners.mean(axis=0)
    forward = images.T_world_camera[0, :3, 2] if marker is None else marker.map_from_marker.R[:, 0]
    moved = world_from_map(floor, forward, origin, scale.metres_per_unit)
    doubted = "marker's size, and that it lies flat" if measures else "lengths" if lengths else "scale that was given"
    doubted = "scale of the device" if device.metric and not scale_is_told(config) else doubted
    warnings += [*more, *others, *_doubtful_height(images.transform(moved), doubted), *unknown]
    return Placement(world_from_map=moved, scale=scale, floor=floor, markers=tuple(measures), warnings=tuple(warnings))


def ruler_of(
    measures: Sequence[MarkerMeasure], sightings: Sequence[MarkerSighting], lengths: Sequence[KnownLength]
) -> Ruler | None:
    """The best of the markers that tell the scale, or the first of the lengths; None where the scale was given."""
    if measures:
        best = min(measures, key=lambda measure: measure.sigma).marker
        seen = [sighting for sighting in sightings if sighting.marker == best]
        return Ruler(measure=partial(marker_side, sightings=seen), images=frozenset(s.image for s in seen))
    if lengths:
        return Ruler(measure=lambda images: measured_length(images, lengths[0])[0], images=frozenset(lengths[0].images))
    return None


def _with_drift(scale: Scale, ruler: Ruler | None, find_drift: FindDrift | None) -> tuple[Scale, list[str]]:
    """The scale with a bent map's share in its interval; with a note if that share is unknown."""
    if ruler is None or find_drift is None:
        return scale, []
    sigma = find_drift(ruler)
    return (scale, [_DRIFT_UNKNOWN]) if sigma is None else (replace(scale, drift=sigma), [])


def _measured_markers(
    images: PosedImages, sightings: Sequence[MarkerSighting], config: MetricConfig
) -> tuple[list[MarkerMeasure], list[str]]:
    """Markers of the known size, and why others could not be measured."""
    if not config.marker_size_m:
        return [], []
    there = sorted({sighting.marker for sighting in sightings})
    asked = list(config.marker_ids) or there
    absent = [marker for marker in asked if marker not in there]
    if absent:
        found = ", ".join(map(str, there)) or "none"
        raise SceneError(f"Marker {absent[0]} of {config.marker_dictionary} is in no image; found: {found}.")
    measures, reasons = [], []
    for marker in asked:
        try:
            measures.append(measure_marker(images, [s for s in sightings if s.marker == marker], config.marker_size_m))
        except SceneError as error:
            reasons.append(str(error))
    if not measures:
        raise SceneError(f"No marker tells the scale: {'; '.join(reasons)}.")
    return measures, reasons


def _scale(
    images: PosedImages,
    measures: list[MarkerMeasure],
    lengths: Sequence[KnownLength],
    config: MetricConfig,
    device: Device,
) -> Scale:
    if device.metric and not scale_is_told(config):
        return Scale(metres_per_unit=device.metres_per_unit, sigma=float("nan"), source=f"the device ({device.name})")
    if measures:
        return scale_of_markers(measures, config.marker_size_m, _MARKER_SIGMA_M)
    if lengths:
        length, sigma = measured_length(images, lengths[0])
        source = f"a length of {lengths[0].length_m:g} m"
        return Scale(metres_per_unit=lengths[0].length_m / length, sigma=sigma, source=source)
    if config.scale:
        return Scale(metres_per_unit=config.scale, sigma=float("nan"), source="given, not measured")
    raise ConfigError(NO_SCALE)


def _length_checks(images: PosedImages, lengths: Sequence[KnownLength], scale: Scale) -> list[str]:
    """What a second length says; one that does not fit is an error.

    Raises:
        SceneError: If a length contradicts the scale.
    """
    said = []
    for known in lengths:
        length, sigma = measured_length(images, known)
        length_m = length * scale.metres_per_unit
        off = length_m / known.length_m - 1.0
        words = f"the length of {known.length_m:g} m is {length_m:.3f} m by {scale.source} ({100 * off:+.1f} %)"
        if abs(off) > TWO_SIDED_95 * math.hypot(sigma, scale.sigma, scale.drift) + _CHECK_TOLERANCE:
            raise SceneError(f"Two measures contradict each other: {words}. Check the marker's printed size.")
        said.append(f"check: {words}")
    return said


def _floor(
    images: PosedImages, measures: list[MarkerMeasure], config: MetricConfig, up: Float64Array
) -> tuple[Floor, MarkerMeasure | None, list[str]]:
    """The floor, the marker that lies on it, and what speaks against it; `up` is as cameras were held, or measured."""
    best = min(measures, key=lambda measure: measure.sigma, default=None)
    if best is not None and config.marker_on == "auto":
        flat = [m for m in measures if lean_deg(m.map_from_marker.R[:, 2], up) <= FLOOR_MARKER_MAX_DEG]
        best = min(flat, key=lambda measure: measure.sigma, default=None)
    if best is not None and config.marker_on != "wall":
        normal = best.map_from_marker.R[:, 2]
        centre = best.corners.mean(axis=0)
        floor = Floor(up=normal, point=centre, source=f"marker {best.marker} on the floor")
        plane = floor_of_points(images, normal)
        if plane is None:
            return floor, best, []
        lean = lean_deg(plane.up, normal)
        told = f"the floor's points ({plane.point_count}) lean {lean:.2f} deg against the marker"
        if config.marker_on == "auto" and _marker_leans(plane, normal, up):
            source = f"{plane.source}; marker {best.marker} leans {lean:.1f} deg against it"
            note = (
                f"{told}, by more than their own uncertainty of {plane.error_deg:.2f} deg: up and z = 0 are the floor's"
            )
            return replace(plane, source=source), best, [note]
        return floor, best, [f"check: {told}"]
    plane = floor_of_points(images, up)
    if plane is not None:
        return plane, None, []
    heights = images.points @ up
    lowest = images.points[np.argsort(heights)[len(heights) // 100]] if len(heights) else np.zeros(3)
    floor = Floor(up=up, point=lowest, source="gravity, as cameras were held; floor at the lowest points")
    return floor, None, ["no floor plane was found: up and z = 0 are rough; put a marker on the floor"]


def _marker_leans(plane: Floor, marker_up: Float64Array, held: Float64Array) -> bool:
    """Whether a marker does not lie flat on the floor, as on a slope or on folded paper.

    Its plane is then not the floor's, beyond the floor's own uncertainty. How cameras were held must not speak for the
    marker, as where the plane of the points is none to stand on.
    """
    differs = lean_deg(plane.up, marker_up) > max(LEAN_MIN_DEG, plane.error_deg)
    return differs and lean_deg(plane.up, held) < lean_deg(marker_up, held) + HELD_ERROR_DEG


def _doubtful_height(images: PosedImages, doubted: str) -> list[str]:
    height_m = float(np.median(images.T_world_camera[:, 2, 3]))
    if _HANDHELD_M[0] <= height_m <= _HANDHELD_M[1]:
        return []
    return [f"cameras are {height_m:.2f} m above the floor in the median: check the {doubted}"]
