"""Lengths that a user measured between two points and picked in two or more images."""

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from readygo.common.errors import ConfigError, SceneError
from readygo.services.reconstructor.metric.triangulate import Triangulated, triangulate
from readygo.services.reconstructor.posed import PosedImages

_PICK = re.compile(r"(\S+):(-?[\d.]+),(-?[\d.]+)")
_PICK_SIGMA_PX = 1.0
"""Standard deviation of picked points [px]."""
_FORM = '"a.jpg:u,v a.jpg:u,v b.jpg:u,v b.jpg:u,v = 2.35": both ends in one image, then in another, and metres'


@dataclass(frozen=True, kw_only=True)
class KnownLength:
    """A length between two points."""

    ends: tuple[tuple[tuple[str, float, float], ...], tuple[tuple[str, float, float], ...]]
    """Picks of the one end and of the other: image, u and v [px], from the image's upper left corner."""
    length_m: float

    @property
    def images(self) -> list[str]:
        """Images in which the length was picked."""
        return [name for name, _, _ in self.ends[0]]


def parse_length(text: str) -> KnownLength:
    """Read a length as it is given on the command line.

    Raises:
        ConfigError: If it does not have the form.
    """
    picks, equals, length = text.partition("=")
    try:
        found = [_parse_pick(word) for word in picks.split()]
        length_m = float(length)
    except ValueError as error:
        raise ConfigError(f"--length {text!r}: {error}; write {_FORM}.") from error
    first, second = tuple(found[0::2]), tuple(found[1::2])
    pairs = all(a[0] == b[0] for a, b in zip(first, second, strict=False))
    if not equals or len(found) % 2 or len({pick[0] for pick in first}) < 2 or not pairs:
        raise ConfigError(f"--length {text!r} must be {_FORM}.")
    if not (length_m > 0 and math.isfinite(length_m)):
        raise ConfigError(f"--length {text!r}: the length must be positive, got {length_m:g} m.")
    return KnownLength(ends=(first, second), length_m=length_m)


def _parse_pick(word: str) -> tuple[str, float, float]:
    match = _PICK.fullmatch(word)
    if match is None:
        raise ValueError(f"{word!r} is no pick")
    return match[1], float(match[2]), float(match[3])


def in_used_images(known: KnownLength, used: Mapping[str, tuple[str, float]]) -> KnownLength:
    """The length with picks in the images that are used, which may be smaller than those that were picked in.

    Args:
        known: As it was told.
        used: By the name of an image that may be told: its name now, and how much smaller it is.

    Raises:
        ConfigError: If there is no such image.
    """
    absent = [name for name in known.images if name not in used]
    if absent:
        raise ConfigError(
            f"--length names {absent[0]}, which is no image here; there are {', '.join(list(used)[:3])}, ..."
        )
    first, second = (
        tuple((used[name][0], u * used[name][1], v * used[name][1]) for name, u, v in picks) for picks in known.ends
    )
    return KnownLength(ends=(first, second), length_m=known.length_m)


def measured_length(images: PosedImages, known: KnownLength) -> tuple[float, float]:
    """The length in units of the map, and its relative standard deviation.

    Raises:
        SceneError: If an image has no pose, or the picks do not meet.
    """
    ends = [_triangulate_picks(images, picks) for picks in known.ends]
    between = ends[1].point - ends[0].point
    length = float(np.linalg.norm(between))
    along = between / max(length, 1e-300)
    variance = sum(float(along @ end.covariance @ along) for end in ends)
    noise_px = max(_PICK_SIGMA_PX, *(float(np.sqrt((end.residuals_px**2).mean())) for end in ends))
    sigma = noise_px * math.sqrt(variance) / max(length, 1e-300)
    if not sigma < 0.2:
        raise SceneError(
            f"The length of {known.length_m:g} m is known to +-{196 * sigma:.0f} % only; pick its ends in images taken "
            "from places farther apart, and check that they are the same points."
        )
    return length, sigma


def _triangulate_picks(images: PosedImages, picks: tuple[tuple[str, float, float], ...]) -> Triangulated:
    missing = [name for name, _, _ in picks if name not in images.names]
    if missing:
        some = ", ".join(images.names[:3])
        raise SceneError(f"--length names {missing[0]}, which has no pose; images with a pose are {some}, ...")
    views = [images.names.index(name) for name, _, _ in picks]
    pixels = [np.array([[u, v]]) for _, u, v in picks]
    rays = np.concatenate([images.rays(view, pixel) for view, pixel in zip(views, pixels, strict=True)])
    try:
        placed = triangulate(rays, images.T_world_camera[views], images.focal_px[views])
    except (ValueError, np.linalg.LinAlgError) as error:
        raise SceneError(f"A point of --length cannot be placed: {error}.") from error
    if placed.residuals_px.max() > 20.0:
        raise SceneError(
            f"The picks of a point of --length miss each other by {placed.residuals_px.max():.0f} px; "
            "pick the same point in each image."
        )
    return placed
