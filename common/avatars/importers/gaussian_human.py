"""Humans as a 3DGS .ply in a canonical pose, with a .npz that binds them to SMPL's skeleton."""

from pathlib import Path

import numpy as np

from readygo.common.array_files import load_npz
from readygo.common.arrays import Float64Array
from readygo.common.avatars.importers.assemble import CanonicalHuman
from readygo.common.avatars.importers.joints import rotations_to_tpose
from readygo.common.errors import AvatarError
from readygo.common.gaussians import load_gaussians

_KEYS = ("lbs_weight", "lbs_index", "joints_canonical", "joints", "joints_tpose", "R_canonical_to_tpose")
_ROW_BYTES_MAX = 2 * 24 * 8
"""Largest size of a Gaussian's row [bytes]: 24 weights and as many joints, in double precision."""
_BYTES_MAX = 2**16
"""Largest size of the other arrays together [bytes]."""


def gaussian_human(ply: Path, weights: Path) -> CanonicalHuman:
    """Read both files.

    Args:
        ply: The Gaussians, SMPL axes.
        weights: Arrays `lbs_weight` (N, 24), or `lbs_index` (N, k) with `lbs_weight` (N, k); the canonical pose's
            `joints_canonical` or `joints` (24, 3); optional `joints_tpose` (24, 3) and `R_canonical_to_tpose`
            (24, 3, 3), without which limbs turn to SMPL's T-pose by the smallest rotations.

    Raises:
        AvatarError: If an array is missing or does not fit the Gaussians.
        SceneError: If the .ply is not a Gaussian file.
    """
    cloud = load_gaussians(ply)
    read = load_npz(weights, _KEYS, bytes_max=_BYTES_MAX + _ROW_BYTES_MAX * len(cloud), raises=AvatarError)
    arrays = {key: array.astype(np.float64) for key, array in read.items() if array.dtype.kind in "fiu"}
    if "joints_canonical" not in arrays and "joints" in arrays:
        arrays["joints_canonical"] = arrays["joints"]
    _require(weights, arrays, "lbs_weight", "joints_canonical")
    joints = _check_shape(weights, arrays, "joints_canonical", (24, 3))
    R = rotations_to_tpose(joints)
    if "R_canonical_to_tpose" in arrays:
        R = _check_shape(weights, arrays, "R_canonical_to_tpose", (24, 3, 3))
        if not np.allclose(R @ R.transpose(0, 2, 1), np.eye(3), atol=1e-3):
            raise AvatarError(f"{weights}: R_canonical_to_tpose must hold rotation matrices.")
    joints_tpose = _check_shape(weights, arrays, "joints_tpose", (24, 3)) if "joints_tpose" in arrays else None
    return CanonicalHuman(
        cloud=cloud,
        weights=_dense_weights(weights, arrays, len(cloud)),
        joints=joints,
        R_tpose_canonical=R,
        joints_tpose=joints_tpose,
    )


def _dense_weights(path: Path, arrays: dict[str, Float64Array], count: int) -> Float64Array:
    weight = arrays["lbs_weight"]
    if weight.ndim != 2 or len(weight) != count:
        raise AvatarError(f"{path}: lbs_weight must have a row for each of the {count} Gaussians, got {weight.shape}.")
    if weight.shape[1] > 24:
        raise AvatarError(f"{path}: lbs_weight must have at most 24 columns, got {weight.shape[1]}.")
    if not np.isfinite(weight).all():
        raise AvatarError(f"{path}: lbs_weight holds values that are not finite.")
    if "lbs_index" not in arrays:
        if weight.shape[1] != 24:
            raise AvatarError(f"{path}: without lbs_index, lbs_weight must have 24 columns, got {weight.shape[1]}.")
        return weight
    index = _check_shape(path, arrays, "lbs_index", weight.shape)
    if index.min() < 0 or index.max() > 23 or (index % 1 != 0).any():
        raise AvatarError(f"{path}: lbs_index must hold joints 0..23.")
    dense = np.zeros((count, 24))
    rows = np.arange(count)
    for column in range(weight.shape[1]):
        np.add.at(dense, (rows, index[:, column].astype(np.int64)), weight[:, column])
    return dense


def _require(path: Path, arrays: dict[str, Float64Array], *keys: str) -> None:
    missing = [key for key in keys if key not in arrays]
    if missing:
        raise AvatarError(f"{path} lacks {', '.join(missing)}; it must bind each Gaussian to joints 0..23.")


def _check_shape(path: Path, arrays: dict[str, Float64Array], key: str, shape: tuple[int, ...]) -> Float64Array:
    array = arrays[key]
    if array.shape != shape:
        raise AvatarError(f"{path}: {key} must have shape {shape}, got {array.shape}.")
    if not np.isfinite(array).all():
        raise AvatarError(f"{path}: {key} holds values that are not finite.")
    return array
