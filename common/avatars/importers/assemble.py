"""From Gaussians on a skeleton in any unit to an avatar: metres, soles at 0, four weights, a T-pose."""

from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, FloatingArray, UInt8Array
from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.importers.joints import JOINT, JOINT_NAMES, tpose_joints
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud

HEIGHTS_M = (0.5, 2.5)
"""Heights that a human can have; another one is taken for another unit of length."""
_EXTENT_PERCENTILES = (0.1, 99.9)
"""Lowest and highest Gaussians that count, so that a floater does not make a giant."""
_SOLID_OPACITY = 0.3
_ANKLES = [JOINT["left_ankle"], JOINT["right_ankle"]]


@dataclass(frozen=True, kw_only=True, eq=False)
class CanonicalHuman:
    """Gaussians bound to SMPL's joints in some upright pose, SMPL axes, any unit of length, anywhere."""

    cloud: GaussianCloud
    weights: Float64Array
    """Skinning weights, not negative, shape (N, 24)."""
    joints: Float64Array
    """Joints in the canonical pose, shape (24, 3)."""
    R_tpose_canonical: Float64Array
    """Rotation of each joint from the canonical pose to the T-pose, shape (24, 3, 3)."""
    joints_tpose: Float64Array | None = None
    """Joints in the T-pose, shape (24, 3); None: bones turned by `R_tpose_canonical`."""


def assemble_avatar(
    human: CanonicalHuman, *, name: str, license_text: str, height_m: float | None = None
) -> tuple[Avatar, float]:
    """The avatar, and the factor from the human's unit of length to metres.

    The sole is where the lowest Gaussians are when the human stands in the T-pose; the canonical pose is placed so
    that the ankles are as high above y = 0 as they are then.

    Args:
        human: Who.
        name: The avatar's name.
        license_text: Under which terms it came.
        height_m: Height to scale to; by default the unit is taken for the metre.

    Raises:
        AvatarError: If numbers are not finite, a Gaussian belongs to no joint, or no human has this height.
    """
    _check(human)
    index, weight = strongest_four(human.weights)
    joints_tpose = human.joints_tpose
    if joints_tpose is None:
        joints_tpose = tpose_joints(human.joints, human.R_tpose_canonical)
    sole, height = _extent(human, index, weight, joints_tpose)
    scale = scale_to_metres(height, height_m)
    up = np.array([0.0, 1.0, 0.0])
    shift_tpose = -sole * up
    shift = (joints_tpose[_ANKLES, 1].mean() - sole - human.joints[_ANKLES, 1].mean()) * up
    cloud = GaussianCloud(
        means_m=_single((human.cloud.means_m + shift) * scale),
        quats_wxyz=human.cloud.quats_wxyz,
        scales_m=_single(human.cloud.scales_m.astype(np.float64) * scale),
        opacities=human.cloud.opacities,
        sh=human.cloud.sh,
    )
    avatar = Avatar(
        name=name,
        license=license_text,
        height_m=round(float(height * scale), 4),
        cloud=cloud,
        lbs_index=index,
        lbs_weight=_single(weight),
        joints_canonical_m=_single((human.joints + shift) * scale),
        joints_tpose_m=_single((joints_tpose + shift_tpose) * scale),
        R_tpose_canonical=_single(human.R_tpose_canonical),
    )
    return avatar, float(scale)


def scale_to_metres(height: float, height_m: float | None) -> float:
    """Factor that makes a human of `height` units one of `height_m`, or 1 if the unit seems to be the metre.

    Raises:
        AvatarError: If no human has this height.
    """
    low, high = HEIGHTS_M
    if height_m is not None:
        if not low <= height_m <= high:
            raise AvatarError(f"--height-m must lie in {low}..{high} m, got {height_m}.")
        if not height > 0.0:
            raise AvatarError("The human has no height; give a file with a body in it.")
        return height_m / height
    if not low <= height <= high:
        raise AvatarError(
            f"The human would be {height:.4g} m tall, expected {low}..{high} m; say the true height with --height-m."
        )
    return 1.0


def strongest_four(weights: Float64Array) -> tuple[UInt8Array, Float64Array]:
    """The four joints that move each Gaussian most, and their weights, rows sum to 1."""
    index = np.argsort(-weights, axis=1, kind="stable")[:, :4]
    weight = np.take_along_axis(weights, index, axis=1)
    return np.ascontiguousarray(index.astype(np.uint8)), weight / weight.sum(axis=1, keepdims=True)


def _check(human: CanonicalHuman) -> None:
    cloud, count = human.cloud, len(human.cloud)
    if count == 0:
        raise AvatarError("The file holds no Gaussian.")
    if human.weights.shape != (count, 24):
        raise AvatarError(f"Skinning weights must be {count} x 24, got {human.weights.shape}.")
    arrays: dict[str, FloatingArray] = {
        "Positions": cloud.means_m,
        "Rotations": cloud.quats_wxyz,
        "Scales": cloud.scales_m,
        "Opacities": cloud.opacities,
        "Colours": cloud.sh,
        "Skinning weights": human.weights,
        "Joints": human.joints,
        "Rotations of joints": human.R_tpose_canonical,
    }
    for what, array in arrays.items():
        if not np.isfinite(array).all():
            raise AvatarError(f"{what} hold values that are not finite; the file is damaged.")
    if human.weights.min() < 0.0:
        raise AvatarError("Skinning weights must not be negative.")
    unbound = int((human.weights.sum(axis=1) < 1e-6).sum())
    if unbound:
        raise AvatarError(f"{unbound} of {count} Gaussians have no skinning weight; each must follow some joint.")
    legs = human.joints[_ANKLES, 1].mean() - human.joints[JOINT["pelvis"], 1]
    if not legs < 0.0 < human.joints[JOINT["head"], 1] - human.joints[JOINT["pelvis"], 1]:
        raise AvatarError(f"{JOINT_NAMES[0]} must lie above the ankles and below the head: y must point up.")


def _extent(
    human: CanonicalHuman, index: UInt8Array, weight: Float64Array, joints_tpose: Float64Array
) -> tuple[float, float]:
    """Height of the sole and of the crown above it, in the T-pose."""
    solid = human.cloud.opacities >= min(_SOLID_OPACITY, float(human.cloud.opacities.max()))
    means = human.cloud.means_m[solid].astype(np.float64)
    rows = human.R_tpose_canonical[:, 1]
    offsets = joints_tpose[:, 1] - np.einsum("jk,jk->j", rows, human.joints)
    y = np.zeros(len(means))
    for k in range(4):
        joint = index[solid, k]
        y += weight[solid, k] * (np.einsum("nk,nk->n", rows[joint], means) + offsets[joint])
    low, high = (float(value) for value in np.percentile(y, _EXTENT_PERCENTILES))
    return low, high - low


def _single(array: Float64Array) -> Float32Array:
    return np.ascontiguousarray(array, dtype=np.float32)
