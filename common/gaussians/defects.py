"""Gaussians that cannot be drawn, and unwanted ones: finding, naming, leaving them out."""

from collections.abc import Mapping

import numpy as np

from readygo.common.arrays import BoolArray, Float32Array
from readygo.common.errors import SceneError
from readygo.common.gaussians.cloud import GaussianCloud
from readygo.common.gaussians.floaters import far_shell, floating

LENGTH_MAX_M = 1e4
"""Coordinates and scales of a scene stay within it [m]: a Gaussian much farther away would cost its neighbours in the
packed scene the precision of their float32 coordinates, a larger one would overflow its covariance."""
COLOUR_MAX = 100.0
"""Largest SH coefficient; packed scenes store steps of the largest one / 32767."""

HUGE_RATIO = 0.2
"""A Gaussian whose standard deviation is a larger part of the scene's width stands for nothing in it."""
HAZE_OPACITY, HAZE_RATIO = 0.1, 3.0
"""Fainter Gaussians that are this many times as large as usual veil what is behind them."""
HUGE, FLOATERS, HAZE, BACKGROUND = "huge", "floaters", "haze", "background"

Masks = dict[str, BoolArray]


def unusable(cloud: GaussianCloud) -> Masks:
    """Gaussians with numbers that are not finite, or without a rotation; in any unit of length.

    A scale of zero is sound: such a Gaussian is drawn one dilated pixel wide.

    Returns:
        Kind of defect -> mask of shape (N,); a Gaussian may have several.
    """
    q = cloud.quats_wxyz.astype(np.float64)
    length2 = q[:, 0] * q[:, 0] + q[:, 1] * q[:, 1] + q[:, 2] * q[:, 2] + q[:, 3] * q[:, 3]
    return {
        "position not finite": ~_finite(cloud.means_m),
        "scale not finite": ~_finite(cloud.scales_m),
        "rotation not finite or zero": ~(np.isfinite(length2) & (length2 > 0)),
        "opacity not finite": ~np.isfinite(cloud.opacities),
        "colour not finite": ~_finite(cloud.sh),
    }


def excessive(cloud: GaussianCloud) -> Masks:
    """Gaussians of finite numbers, in metres, that lie or reach too far, or are too bright; as `unusable`."""
    return {
        f"position beyond {LENGTH_MAX_M:g} m": _largest(cloud.means_m) > LENGTH_MAX_M,
        f"scale above {LENGTH_MAX_M:g} m": _largest(cloud.scales_m) > LENGTH_MAX_M,
        f"colour beyond {COLOUR_MAX:g}": _largest(cloud.sh) > COLOUR_MAX,
    }


def unwanted_masks(cloud: GaussianCloud) -> Masks:
    """Gaussians that can be drawn but spoil a scene, in any unit of length; as `unusable`, but each has one kind.

    "huge": larger than a fifth of the scene. "floaters": groups of a few that touch nothing else, or lie far outside,
    and clouds of them in or around a scene. "haze": faint and several times as large as usual. What is `background`
    is none of these.
    """
    return {kind: mask for kind, mask in told_apart(cloud).items() if kind != BACKGROUND}


def told_apart(cloud: GaussianCloud) -> Masks:
    """The kinds of `unwanted_masks`, and "background": what looks like them, but is sky and far surroundings."""
    low, high = np.quantile(cloud.means_m.astype(np.float64), [0.01, 0.99], axis=0)
    width = max(float((high - low).max()), 1e-9)
    reach = cloud.scales_m.max(axis=1)
    huge = reach > HUGE_RATIO * width
    haze = ~huge & (cloud.opacities < HAZE_OPACITY) & (reach > HAZE_RATIO * np.median(reach))
    floaters = np.zeros(len(cloud), np.bool_)
    solid = ~huge & ~haze
    floaters[solid] = floating(cloud.select(solid), low, high)
    shell = far_shell(cloud, huge | floaters | haze, low, high)
    return {HUGE: huge & ~shell, FLOATERS: floaters & ~shell, HAZE: haze & ~shell, BACKGROUND: shell}


def count_kinds(masks: Masks) -> str:
    """The kinds that occur, with their numbers, in words."""
    return ", ".join(f"{kind}: {int(mask.sum()):,}" for kind, mask in masks.items() if mask.any()) or "none"


def without(cloud: GaussianCloud, masks: Masks) -> tuple[GaussianCloud, dict[str, int]]:
    """The cloud without the Gaussians of some masks, and how many have each defect that occurs."""
    bad: BoolArray = np.logical_or.reduce(list(masks.values()))
    counts = {kind: int(mask.sum()) for kind, mask in masks.items() if mask.any()}
    return (cloud.select(~bad) if counts else cloud), counts


def refusal(name: str, counts: Mapping[str, int], bad: int, total: int, remedy: str) -> SceneError:
    """The error that names how many Gaussians have which defect."""
    kinds = ", ".join(f"{kind}: {count}" for kind, count in counts.items())
    return SceneError(f"{name} has {bad} of {total} Gaussians that cannot be drawn ({kinds}); {remedy}.")


def _finite(array: Float32Array) -> BoolArray:
    return np.asarray(np.isfinite(array).all(axis=tuple(range(1, array.ndim))))


def _largest(array: Float32Array) -> Float32Array:
    largest: Float32Array = np.abs(array).max(axis=tuple(range(1, array.ndim)), initial=0.0)
    return largest
