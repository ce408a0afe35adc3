"""From Gaussians on a skeleton in any unit to an avatar: metres, soles at 0, four weights, a T-pose."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.importers.joints import JOINT, JOINT_NAMES, tpose_joints
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud

Array = npt.NDArray[np.float64]

HEIGHTS_M = (0.5, 2.5)
"""Heights that a person can have; another one is taken for another unit of length."""
_EXTENT_PERCENTILES = (0.1, 99.9)
"""Lowest and highest Gaussians that count, so that a floater does not make a giant."""
_SOLID_OPACITY = 0.3
_ANKLES = [JOINT["left_ankle"], JOINT["right_ankle"]]


@dataclass(frozen=True, kw_only=True, eq=False)
class CanonicalPerson:
    """Gaussians bound to SMPL's joints in some upright pose, SMPL axes, any unit of length, anywhere."""

    cloud: GaussianCloud
    weights: Array
    """Skinning weights, not negative, shape (N, 24)."""
    joints: Array
    """Joints in the canonical pose, shape (24, 3)."""
    R_tpose_canonical: Array
    """Rotation of each joint from the canonical pose to the T-pose, shape (24, 3, 3)."""
    joints_tpose: Array | None = None
    """Joints in the T-pose, shape (24, 3); None: bones turned by `R_tpose_canonical`."""


def assembled(
    person: CanonicalPerson, *, name: str, license_text: str, height_m: float | None = None
) -> tuple[Avatar, float]:
    """The avatar, and the factor from the person's unit of length to metres.

    The sole is where the lowest Gaussians are when the person stands in the T-pose; the canonical pose is placed so
    that the ankles are as high above y = 0 as they are then.

    Args:
        person: Who.
        name: The avatar's name.
        license_text: Under which terms it came.
        height_m: Height to scale to; by default the unit is taken for the metre.

    Raises:
        AvatarError: If numbers are not finite, a Gaussian belongs to no joint, or no person has this height.
    """
    _check(person)
    index, weight = strongest_four(person.weights)
    joints_tpose = person.joints_tpose
    if joints_tpose is None:
        joints_tpose = tpose_joints(person.joints, person.R_tpose_canonical)
    sole, height = _extent(person, index, weight, joints_tpose)
    scale = scale_to_metres(height, height_m)
    up = np.array([0.0, 1.0, 0.0])
    shift_tpose = -sole * up
    shift = (joints_tpose[_ANKLES, 1].mean() - sole - person.joints[_ANKLES, 1].mean()) * up
    cloud = GaussianCloud(
        means_m=_single((person.cloud.means_m + shift) * scale),
        quats_wxyz=person.cloud.quats_wxyz,
        scales_m=_single(person.cloud.scales_m.astype(np.float64) * scale),
        opacities=person.cloud.opacities,
        sh=person.cloud.sh,
    )
    avatar = Avatar(
        name=name,
        license=license_text,
        height_m=round(float(height * scale), 4),
        cloud=cloud,
        lbs_index=index,
        lbs_weight=_single(weight),
        joints_canonical_m=_single((person.joints + shift) * scale),
        joints_tpose_m=_single((joints_tpose + shift_tpose) * scale),
        R_tpose_canonical=_single(person.R_tpose_canonical),
    )
    return avatar, float(scale)


def scale_to_metres(height: float, height_m: float | None) -> float:
    """Factor that makes a person of `height` units one of `height_m`, or 1 if the unit seems to be the metre.

    Raises:
        AvatarError: If no person has this height.
    """
    low, high = HEIGHTS_M
    if height_m is not None:
        if not low <= height_m <= high:
            raise AvatarError(f"--height-m must lie in {low}..{high} m, got {height_m}.")
        if not height > 0.0:
            raise AvatarError("The person has no height; give a file with a body in it.")
        return height_m / height
    if not low <= height <= high:
        raise AvatarError(
            f"The person would be {height:.4g} m tall, expected {low}..{high} m; say the true height with --height-m."
        )
    return 1.0


def strongest_four(weights: Array) -> tuple[npt.NDArray[np.uint8], Array]:
    """The four joints that move each Gaussian most, and their weights, rows sum to 1."""
    index = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    weight = np.take_along_axis(weights, index, axis=1)
    return np.ascontiguousarray(index.astype(np.uint8)), weight / weight.sum(axis=1, keepdims=True)


def _check(person: CanonicalPerson) -> None:
    cloud, count = person.cloud, len(person.cloud)
    if count == 0:
        raise AvatarError("The file holds no Gaussian.")
    if person.weights.shape != (count, 24):
        raise AvatarError(f"Skinning weights must be {count} x 24, got {person.weights.shape}.")
    arrays: dict[str, npt.NDArray[np.floating]] = {
        "Positions": cloud.means_m,
        "Rotations": cloud.quats_wxyz,
        "Scales": cloud.scales_m,
        "Opacities": cloud.opacities,
        "Colours": cloud.sh,
        "Skinning weights": person.weights,
        "Joints": person.joints,
        "Rotations of joints": person.R_tpose_canonical,
    }
    for what, array in arrays.items():
        if not np.isfinite(array).all():
            raise AvatarError(f"{what} hold values that are not finite; the file is damaged.")
    if person.weights.min() < 0.0:
        raise AvatarError("Skinning weights must not be negative.")
    unbound = int((person.weights.sum(axis=1) < 1e-6).sum())
    if unbound:
        raise AvatarError(f"{unbound} of {count} Gaussians have no skinning weight; each must follow some joint.")
    legs = person.joints[_ANKLES, 1].mean() - person.joints[JOINT["pelvis"], 1]
    if not legs < 0.0 < person.joints[JOINT["head"], 1] - person.joints[JOINT["pelvis"], 1]:
        raise AvatarError(f"{JOINT_NAMES[0]} must lie above the ankles and below the head: y must point up.")


def _extent(
    person: CanonicalPerson, index: npt.NDArray[np.uint8], weight: Array, joints_tpose: Array
) -> tuple[float, float]:
    """Height of the sole and of the crown above it, in the T-pose."""
    solid = person.cloud.opacities >= min(_SOLID_OPACITY, float(person.cloud.opacities.max()))
    means = person.cloud.means_m[solid].astype(np.float64)
    rows = person.R_tpose_canonical[:, 1]
    offsets = joints_tpose[:, 1] - np.einsum("jk,jk->j", rows, person.joints)
    y = np.zeros(len(means))
    for k in range(4):
        joint = index[solid, k]
        y += weight[solid, k] * (np.einsum("nk,nk->n", rows[joint], means) + offsets[joint])
    low, high = (float(value) for value in np.percentile(y, _EXTENT_PERCENTILES))
    return low, high - low


def _single(array: Array) -> npt.NDArray[np.float32]:
    return np.ascontiguousarray(array, dtype=np.float32)
