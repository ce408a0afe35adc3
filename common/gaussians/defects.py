"""Gaussians that cannot be drawn: finding them, naming them, leaving them out."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from readygo.common.errors import SceneError
from readygo.common.gaussians.cloud import GaussianCloud

LENGTH_MAX_M = 1e4
"""Coordinates and scales of a scene stay within it [m]: a Gaussian much farther away would cost its neighbours in the
packed scene the precision of their float32 coordinates, a larger one would overflow its covariance."""
COLOUR_MAX = 100.0
"""Largest SH coefficient; packed scenes store steps of the largest one / 32767."""

Masks = dict[str, npt.NDArray[np.bool_]]


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


def without(cloud: GaussianCloud, masks: Masks) -> tuple[GaussianCloud, dict[str, int]]:
    """The cloud without the Gaussians of some masks, and how many have each defect that occurs."""
    bad: npt.NDArray[np.bool_] = np.logical_or.reduce(list(masks.values()))
    counts = {kind: int(mask.sum()) for kind, mask in masks.items() if mask.any()}
    return (cloud.select(~bad) if counts else cloud), counts


def refusal(name: str, counts: Mapping[str, int], bad: int, total: int, remedy: str) -> SceneError:
    """The error that names how many Gaussians have which defect."""
    kinds = ", ".join(f"{kind}: {count}" for kind, count in counts.items())
    return SceneError(f"{name} has {bad} of {total} Gaussians that cannot be drawn ({kinds}); {remedy}.")


def _finite(array: npt.NDArray[np.float32]) -> npt.NDArray[np.bool_]:
    return np.asarray(np.isfinite(array).all(axis=tuple(range(1, array.ndim))))


def _largest(array: npt.NDArray[np.float32]) -> npt.NDArray[np.float32]:
    largest: npt.NDArray[np.float32] = np.abs(array).max(axis=tuple(range(1, array.ndim)), initial=0.0)
    return largest
