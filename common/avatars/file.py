"""Avatar files, format `readygo-avatar/1`: a NumPy archive that may hold half-precision or 8-bit arrays."""

import hashlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from readygo.common.array_files import load_npz
from readygo.common.arrays import AnyArray, Float32Array, Float64Array
from readygo.common.avatars.avatar import SMPL_PARENTS, Avatar
from readygo.common.errors import AvatarError
from readygo.common.files import write_then_rename
from readygo.common.gaussians import GaussianCloud

FORMAT = "readygo-avatar/1"
EMBEDDED_FOLDER = Path(__file__).parent / "data"
"""The avatars that come with the product."""
POSES_ENDING = ".poses.npz"
"""Of the file of the poses that an avatar was found with, beside it; it is no avatar."""

GAUSSIANS_MAX = 500_000
"""An avatar has no more; those of photos have some 100,000."""
_BYTES_MAX = GAUSSIANS_MAX * 600
"""Largest size of all arrays [bytes]: a Gaussian has 67 numbers of at most 8 bytes."""

_ARRAY_SHAPES: dict[str, tuple[int | str, ...]] = {
    "means": ("N", 3),
    "quats_wxyz": ("N", 4),
    "scales": ("N", 3),
    "opacities": ("N",),
    "sh": ("N", "K", 3),
    "lbs_index": ("N", 4),
    "lbs_weight": ("N", 4),
    "parents": (24,),
    "joints_canonical": (24, 3),
    "joints_tpose": (24, 3),
    "R_canonical_to_tpose": (24, 3, 3),
}
_INTEGER_ARRAYS = ("lbs_index", "parents")
_TEXTS = ("format", "name", "license")
_TEXT_MAX = 2000
# Half precision keeps a mean within 0.5 mm (a human is below 2 m); 8 bits would move it by 4 mm.
_HALF_PRECISION = ("means",)
_EIGHT_BIT = ("quats_wxyz", "scales", "opacities", "sh", "lbs_weight")
_KEYS = (*_TEXTS, "height_m", *(f"{key}{end}" for key in _ARRAY_SHAPES for end in ("", "_min", "_max")))


def load_avatar(path: str | Path) -> Avatar:
    """Read an avatar file; quaternions and skinning weights come back normalised.

    Args:
        path: A `.npz` of format `readygo-avatar/1`. An array may be float32, float16, or uint8 with
            `<key>_min` and `<key>_max`: value = min + code / 255 * (max - min).

    Raises:
        AvatarError: If the file cannot be read, or a key is missing, misshapen or holds a value that no avatar has.
    """
    path = Path(path)
    entries = load_npz(path, _KEYS, bytes_max=_BYTES_MAX, raises=AvatarError)
    missing = sorted((set(_ARRAY_SHAPES) | set(_TEXTS) | {"height_m"}) - set(entries))
    if missing:
        raise AvatarError(f"Avatar file {path} lacks {', '.join(missing)}; bake or import it again.")
    _check_texts(path, entries)
    _check_shapes(path, entries)
    arrays = {key: _values(path, entries, key) for key in _ARRAY_SHAPES}
    _check_values(path, arrays)
    return _avatar(path, entries, arrays)


def save_avatar(avatar: Avatar, path: str | Path, *, quantise: bool = True) -> None:
    """Write an avatar file that `load_avatar` reads back.

    Args:
        avatar: The avatar.
        path: Where to write; appears only once it is complete.
        quantise: Store means as float16 and everything else that is per Gaussian in 8 bits (about a third of the
            size; colours move by at most 1/510 of their range, means by at most 0.5 mm). Otherwise float32.

    Raises:
        AvatarError: If the file cannot be written, or could not be read back: it has too many Gaussians or long texts.
    """
    path = Path(path)
    check_texts(avatar.name, avatar.license)
    cloud = avatar.cloud
    if len(cloud) > GAUSSIANS_MAX:
        raise AvatarError(f"Avatar {avatar.name!r} has {len(cloud)} Gaussians; give at most {GAUSSIANS_MAX}.")
    floats = {
        "means": cloud.means_m,
        "quats_wxyz": cloud.quats_wxyz,
        "scales": cloud.scales_m,
        "opacities": cloud.opacities,
        "sh": cloud.sh,
        "lbs_weight": avatar.lbs_weight,
    }
    entries: dict[str, Any] = {
        "format": np.array(FORMAT),
        "name": np.array(avatar.name),
        "license": np.array(avatar.license),
        "height_m": np.float32(avatar.height_m),
        "lbs_index": avatar.lbs_index,
        "parents": SMPL_PARENTS.astype(np.int8),
        "joints_canonical": avatar.joints_canonical_m,
        "joints_tpose": avatar.joints_tpose_m,
        "R_canonical_to_tpose": avatar.R_tpose_canonical,
    }
    for key, array in floats.items():
        entries |= _encode_array(key, array, quantise)
    with write_then_rename(path, raises=AvatarError) as part:
        np.savez_compressed(part, allow_pickle=False, **entries)


def check_texts(name: str, license_text: str) -> None:
    """Check what is written of an avatar besides its body, before the work on that begins.

    Raises:
        AvatarError: If `load_avatar` would refuse it.
    """
    for what, text in (("name", name), ("license", license_text)):
        if len(text) > _TEXT_MAX:
            raise AvatarError(f"An avatar's {what} has at most {_TEXT_MAX} characters, got {len(text)}; shorten it.")


def avatar_paths(path: Path | None) -> tuple[Path, ...]:
    """The avatar files of a folder, or one file; None stands for the embedded avatars.

    Raises:
        AvatarError: If there is none.
    """
    place = EMBEDDED_FOLDER if path is None else path
    if place.is_file():
        return (place,)
    if not place.is_dir():
        raise AvatarError(f"Avatar path {place} does not exist; give a folder of .npz files or one such file.")
    found = tuple(sorted(path for path in place.glob("*.npz") if not path.name.endswith(POSES_ENDING)))
    if not found:
        raise AvatarError(f"Folder {place} holds no avatar (.npz); give a folder of avatar files.")
    return found


def load_avatars(path: Path | None = None) -> dict[str, Avatar]:
    """Avatars by name, in the order of their names.

    Args:
        path: A folder of `.npz` files or one file; None stands for the embedded avatars.

    Raises:
        AvatarError: If there is none, one cannot be read, or two have the same name.
    """
    avatars: dict[str, Avatar] = {}
    for file in avatar_paths(path):
        avatar = load_avatar(file)
        if avatar.name in avatars:
            raise AvatarError(f"Avatar file {file} has the name {avatar.name!r} of another file; rename one.")
        avatars[avatar.name] = avatar
    return dict(sorted(avatars.items()))


def avatar_hash(avatar: Avatar) -> str:
    """SHA-256 of what an avatar looks like and how it moves, hexadecimal; how its file is compressed does not matter.

    A run records it to say whom it showed.
    """
    cloud = avatar.cloud
    arrays = (
        cloud.means_m,
        cloud.quats_wxyz,
        cloud.scales_m,
        cloud.opacities,
        cloud.sh,
        avatar.lbs_index,
        avatar.lbs_weight,
        avatar.joints_canonical_m,
        avatar.joints_tpose_m,
        avatar.R_tpose_canonical,
    )
    digest = hashlib.sha256(f"{FORMAT} {avatar.name} {avatar.height_m!r}".encode())
    for array in arrays:
        digest.update(f"{array.dtype.str} {array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()


def _text(entries: Mapping[str, AnyArray], key: str) -> str:
    return str(entries[key])


def _check_texts(path: Path, entries: Mapping[str, AnyArray]) -> None:
    for key in _TEXTS:
        text = entries[key]
        if text.shape != () or text.dtype.kind != "U" or len(str(text)) > _TEXT_MAX:
            raise AvatarError(f"Avatar file {path}: {key} must be one text of at most {_TEXT_MAX} characters.")
    if _text(entries, "format") != FORMAT:
        raise AvatarError(f"Avatar file {path} has format {_text(entries, 'format')[:40]!r}, expected {FORMAT!r}.")


def _values(path: Path, entries: Mapping[str, AnyArray], key: str) -> AnyArray:
    array = entries[key]
    if key in _INTEGER_ARRAYS:
        if array.dtype.kind not in "iu":
            raise AvatarError(f"Avatar file {path}: {key} must hold integers, got {array.dtype}.")
        return array.astype(np.int64)
    if array.dtype.kind == "f":
        return array.astype(np.float64)
    if array.dtype != np.uint8 or f"{key}_min" not in entries or f"{key}_max" not in entries:
        raise AvatarError(
            f"Avatar file {path}: {key} must be floating point, or uint8 with {key}_min and {key}_max, "
            f"got {array.dtype}."
        )
    low, high = (entries[f"{key}_{end}"] for end in ("min", "max"))
    if not all(ends.dtype.kind in "fiu" and _fits(ends.shape, array.shape) for ends in (low, high)):
        raise AvatarError(
            f"Avatar file {path}: {key}_min {low.shape} and {key}_max {high.shape} do not fit {key} {array.shape}."
        )
    low, high = low.astype(np.float64), high.astype(np.float64)
    return np.asarray(low + array / 255.0 * (high - low))


def _fits(ends: tuple[int, ...], shape: tuple[int, ...]) -> bool:
    """True if an array of shape `ends` can be repeated to `shape`."""
    try:
        return np.broadcast_shapes(ends, shape) == shape
    except ValueError:
        return False


def _check_shapes(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    count = len(arrays["means"]) if arrays["means"].ndim else 0
    degrees = arrays["sh"].shape[1] if arrays["sh"].ndim == 3 else 0
    for key, shape in _ARRAY_SHAPES.items():
        want = tuple({"N": count, "K": degrees}[item] if isinstance(item, str) else item for item in shape)
        if arrays[key].shape != want:
            raise AvatarError(f"Avatar file {path}: {key} must have shape {shape}, got {arrays[key].shape}.")
    if count == 0:
        raise AvatarError(f"Avatar file {path} holds no Gaussian.")
    if count > GAUSSIANS_MAX:
        raise AvatarError(f"Avatar file {path} holds {count} Gaussians; an avatar has at most {GAUSSIANS_MAX}.")
    if degrees not in (1, 4, 9, 16):
        raise AvatarError(f"Avatar file {path}: sh must have 1, 4, 9 or 16 coefficients, got {degrees}.")


def _check_values(path: Path, arrays: Mapping[str, AnyArray]) -> None:
    endless = [key for key, array in arrays.items() if not np.isfinite(array).all()]
    if endless:
        raise AvatarError(f"Avatar file {path}: {', '.join(endless)} hold values that are not finite.")
    if not np.array_equal(arrays["parents"], SMPL_PARENTS):
        raise AvatarError(f"Avatar file {path}: parents are not those of the SMPL-24 skeleton.")
    faults = {
        "quats_wxyz holds a zero quaternion": (arrays["quats_wxyz"] ** 2).sum(axis=1).min() < 1e-6,
        "scales must be positive": arrays["scales"].min() <= 0,
        "opacities must lie in 0..1": arrays["opacities"].min() < 0 or arrays["opacities"].max() > 1.0 + 1e-6,
        "lbs_index must lie in 0..23": arrays["lbs_index"].min() < 0 or arrays["lbs_index"].max() > 23,
        "lbs_weight must not be negative": arrays["lbs_weight"].min() < 0,
        "lbs_weight holds a row of zeros": arrays["lbs_weight"].sum(axis=1).min() < 1e-3,
    }
    for fault, present in faults.items():
        if present:
            raise AvatarError(f"Avatar file {path}: {fault}.")


def _avatar(path: Path, entries: Mapping[str, AnyArray], arrays: Mapping[str, AnyArray]) -> Avatar:
    height = entries["height_m"]
    if height.shape != () or height.dtype.kind not in "fiu" or not 0.2 < float(height) < 3.0:
        raise AvatarError(f"Avatar file {path}: height_m must be one number in 0.2..3 m, got {height}.")
    q, w = arrays["quats_wxyz"], arrays["lbs_weight"]
    norm = np.sqrt(q[:, 0] * q[:, 0] + q[:, 1] * q[:, 1] + q[:, 2] * q[:, 2] + q[:, 3] * q[:, 3])
    total = w[:, 0] + w[:, 1] + w[:, 2] + w[:, 3]
    cloud = GaussianCloud(
        means_m=_single(arrays["means"]),
        quats_wxyz=_single(q / norm[:, None]),
        scales_m=_single(arrays["scales"]),
        opacities=_single(np.minimum(arrays["opacities"], 1.0)),
        sh=_single(arrays["sh"]),
    )
    return Avatar(
        name=_text(entries, "name"),
        license=_text(entries, "license"),
        height_m=round(float(height), 4),
        cloud=cloud,
        lbs_index=np.ascontiguousarray(arrays["lbs_index"].astype(np.uint8)),
        lbs_weight=_single(w / total[:, None]),
        joints_canonical_m=_single(arrays["joints_canonical"]),
        joints_tpose_m=_single(arrays["joints_tpose"]),
        R_tpose_canonical=_single(arrays["R_canonical_to_tpose"]),
    )


def _single(array: Float64Array) -> Float32Array:
    return np.ascontiguousarray(array, dtype=np.float32)


def _encode_array(key: str, array: Float32Array, quantise: bool) -> dict[str, AnyArray]:
    if not quantise:
        return {key: array}
    if key in _HALF_PRECISION:
        return {key: array.astype(np.float16)}
    assert key in _EIGHT_BIT
    low, high = array.min(axis=0), array.max(axis=0)
    span = np.where(high > low, high - low, 1.0)
    codes = np.rint((array.astype(np.float64) - low) / span * 255.0).astype(np.uint8)
    return {key: codes, f"{key}_min": low, f"{key}_max": high}
