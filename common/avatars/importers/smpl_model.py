"""SMPL model files (.npz, .pkl), which users bring under their own license."""

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from readygo.common.array_files import load_npz
from readygo.common.arrays import AnyArray, Float64Array, Int64Array
from readygo.common.avatars.avatar import SMPL_PARENTS
from readygo.common.errors import AvatarError
from readygo.common.files import open_regular
from readygo.common.pickles import array_of, load_pickle

MODEL_KEYS = ("v_template", "weights", "J_regressor", "kintree_table")
"""What every SMPL model file holds; `f` (faces) and `shapedirs` are needed only by some uses."""
_VERSIONS = {16: "MANO, a hand", 52: "SMPL-H, with hands", 55: "SMPL-X", 24: "no SMPL model, as their parents differ"}
"""What models with other skeletons are, by their joints."""
_ALL_KEYS = (*MODEL_KEYS, "f", "shapedirs")
_BYTES_MAX = 2**28
"""A model with 300 shape directions has 60 MB in these arrays, 250 MB as a pickle of all."""
_NUMBERS_MAX = 2**24
"""Most numbers in an array; those of 300 shape directions are 6 million."""


@dataclass(frozen=True, kw_only=True, eq=False)
class SmplModel:
    """A SMPL body of one shape in its zero pose (y up, +x the body's left, +z facing)."""

    vertices_m: Float64Array
    """Vertices in the zero pose [m], shape (V, 3)."""
    faces: Int64Array
    """Corners of triangles, shape (F, 3); F may be 0."""
    weights: Float64Array
    """Skinning weights, shape (V, 24)."""
    joints_m: Float64Array
    """Joints in the zero pose [m], shape (24, 3)."""


def load_smpl_model(path: str | Path, *, betas: npt.ArrayLike | None = None) -> SmplModel:
    """Read a SMPL model file.

    Args:
        path: A `.npz`, or a pickle (old ones with chumpy arrays as well; nothing in it is run).
        betas: Shape coefficients, at most as many as the file has shape directions; None stands for the mean shape.

    Raises:
        AvatarError: If the file cannot be read, or is not a SMPL model of 24 joints.
    """
    path = Path(path)
    entries = smpl_entries(path)
    missing = [key for key in MODEL_KEYS if key not in entries]
    if missing:
        raise AvatarError(f"{path} lacks {', '.join(missing)}: it is not a SMPL model file.")
    table = _array(path, entries, "kintree_table", (2, None)).astype(np.int64)
    joint_count = table.shape[1]
    parents = np.where(table[0] >= joint_count, -1, table[0])
    if joint_count != 24 or not np.array_equal(parents, SMPL_PARENTS):
        version = _VERSIONS.get(joint_count, "not SMPL")
        raise AvatarError(f"{path} has {joint_count} joints: it is {version}. Give a SMPL model, which has 24 joints.")
    template = _array(path, entries, "v_template", (None, 3)).astype(np.float64)
    count = len(template)
    vertices = template + _shape_offsets(path, entries, count, betas)
    regressor = _array(path, entries, "J_regressor", (24, count)).astype(np.float64)
    weights = _array(path, entries, "weights", (count, 24)).astype(np.float64)
    faces = np.empty((0, 3), dtype=np.int64)
    if "f" in entries:
        faces = _array(path, entries, "f", (None, 3)).astype(np.int64)
    if len(faces) and (faces.min() < 0 or faces.max() >= count):
        raise AvatarError(f"{path}: f names vertices beyond the {count} of v_template.")
    return SmplModel(vertices_m=vertices, faces=faces, weights=weights, joints_m=regressor @ vertices)


def smpl_entries(path: Path) -> Mapping[str, Any]:
    """Entries of a model file by name, still as the file has them.

    Raises:
        AvatarError: If the file is neither a NumPy archive nor a pickled dictionary.
    """
    with open_regular(path) as stream:
        start = stream.read(4)
    if start[:2] == b"PK":
        return load_npz(path, _ALL_KEYS, bytes_max=_BYTES_MAX, raises=AvatarError)
    entries = load_pickle(path, bytes_max=_BYTES_MAX, raises=AvatarError)
    if not isinstance(entries, dict):
        raise AvatarError(f"{path} holds a {type(entries).__name__}, not the dictionary of a SMPL model.")
    return entries


def _shape_offsets(path: Path, entries: Mapping[str, Any], count: int, betas: npt.ArrayLike | None) -> Float64Array:
    if betas is None:
        return np.zeros((count, 3))
    coefficients = np.asarray(betas, dtype=np.float64).reshape(-1)
    if not np.isfinite(coefficients).all():
        raise AvatarError("Shape coefficients (betas) must be finite numbers.")
    if "shapedirs" not in entries:
        raise AvatarError(f"{path} has no shapedirs, so that betas cannot be applied.")
    directions = _array(path, entries, "shapedirs", (count, 3, None))
    if len(coefficients) > directions.shape[2]:
        raise AvatarError(f"{path} has {directions.shape[2]} shape directions, but {len(coefficients)} betas came.")
    offsets: Float64Array = directions[:, :, : len(coefficients)].astype(np.float64) @ coefficients
    return offsets


def _array(path: Path, entries: Mapping[str, Any], key: str, shape: tuple[int | None, ...]) -> AnyArray:
    array = array_of(entries[key])
    if array is None or array.dtype.kind not in "fiu":
        raise AvatarError(f"{path}: {key} holds no numbers that can be read.")
    fits = array.ndim == len(shape) and all(want in (None, got) for want, got in zip(shape, array.shape, strict=True))
    if not fits:
        text = " x ".join("any" if size is None else str(size) for size in shape)
        raise AvatarError(f"{path}: {key} must be {text}, got {array.shape}.")
    if array.size > _NUMBERS_MAX:
        raise AvatarError(f"{path}: {key} holds {array.size} numbers, a SMPL model's at most {_NUMBERS_MAX}.")
    if not np.isfinite(array).all():
        raise AvatarError(f"{path}: {key} holds values that are not finite.")
    return array
