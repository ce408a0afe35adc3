"""What a fit comes to: an avatar with soles on the ground, and what no frame has shown of it."""

import dataclasses

import numpy as np
from scipy.spatial import cKDTree

from readygo.common.arrays import BoolArray, Float32Array, Float64Array
from readygo.common.avatars import Avatar
from readygo.common.avatars.importers.assemble import CanonicalHuman, assemble_avatar
from readygo.common.avatars.mesh_look import BODY_PARTS
from readygo.common.gaussians import GaussianCloud
from readygo.services.reconstructor.avatars.fit import PersonFit
from readygo.services.reconstructor.avatars.skinning import skin_gaussians

OPACITY_MIN = 0.1
"""Fainter Gaussians are left out."""
_LENDERS = 4
"""What no frame has shown takes the mean colour of so many neighbours that some frame has shown."""


def avatar_of_fit(fit: PersonFit, body: Avatar, name: str, license_text: str) -> tuple[Avatar, dict[str, float]]:
    """The avatar, and the share of each part of the body that no frame has shown.

    Args:
        fit: A finished fit.
        body: The body that it began with.
        name: Name of the avatar.
        license_text: Its license.

    Raises:
        AvatarError: If it has no human's height.
    """
    solid = fit.bound.gaussians.opacities >= OPACITY_MIN
    seen = fit.seen()[solid]
    bound, values = fit.bound, fit.bound.gaussians.values
    tpose, canonical, B = fit.rig.shaped_joints()
    still = np.tile(np.eye(3, 4, dtype=np.float32), (24, 1, 1))
    upright = np.tile(np.array([1, 0, 0, 0], dtype=np.float32), (24, 1))
    shaped = skin_gaussians(
        values["means_m"], values["quats_wxyz"], bound.joint, bound.weight, still, B, upright
    ).shaped_m[solid]
    quats = values["quats_wxyz"][solid]
    joint, weight = bound.joint[solid], bound.weight[solid]
    cloud = GaussianCloud(
        means_m=shaped,
        quats_wxyz=quats / np.linalg.norm(quats, axis=1, keepdims=True),
        scales_m=bound.gaussians.scales_m[solid] * np.float32(fit.rig.size),
        opacities=bound.gaussians.opacities[solid],
        sh=lend_colours(shaped, values["sh"][solid], seen)[:, None],
    )
    weights = np.zeros((len(shaped), 24))
    for k in range(4):
        np.add.at(weights, (np.arange(len(shaped)), joint[:, k]), weight[:, k])
    human = CanonicalHuman(
        cloud=cloud,
        weights=weights,
        joints=canonical,
        R_tpose_canonical=body.R_tpose_canonical.astype(np.float64),
        joints_tpose=tpose,
    )
    avatar, _ = assemble_avatar(human, name=name, license_text=license_text)
    return avatar, unseen_shares(avatar, seen)


def lend_colours(means_m: Float32Array, sh: Float32Array, seen: BoolArray) -> Float32Array:
    """Colours (N, 3), those of Gaussians that nothing has shown taken from their neighbours.

    Args:
        means_m: Shape (N, 3).
        sh: Shape (N, 3).
        seen: Which Gaussians some frame shows, shape (N,).
    """
    if seen.all() or not seen.any():
        return sh
    _, near = cKDTree(means_m[seen]).query(means_m[~seen], k=min(_LENDERS, int(seen.sum())))
    out = sh.copy()
    out[~seen] = sh[seen][near.reshape(int((~seen).sum()), -1)].mean(axis=1)
    return out


def unseen_shares(avatar: Avatar, seen: BoolArray) -> dict[str, float]:
    """Share of the surface of each part of the body that no frame shows, by the parts of `BODY_PARTS`."""
    strongest = avatar.lbs_index[np.arange(len(seen)), avatar.lbs_weight.argmax(axis=1)]
    scales = np.sort(avatar.cloud.scales_m.astype(np.float64), axis=1)
    area: Float64Array = scales[:, 1] * scales[:, 2]
    shares = {}
    for part, joints in BODY_PARTS.items():
        rows = np.isin(strongest, joints)
        shares[part] = round(float(area[rows & ~seen].sum() / max(area[rows].sum(), 1e-12)), 4) if rows.any() else 1.0
    return shares


def without_floaters(avatar: Avatar, distance_m: float) -> Avatar:
    """The avatar without Gaussians whose neighbours are all farther than `distance_m`."""
    distance, _ = cKDTree(avatar.cloud.means_m).query(avatar.cloud.means_m, k=min(4, len(avatar.cloud)))
    kept = distance.reshape(len(avatar.cloud), -1)[:, -1] <= distance_m
    if kept.all():
        return avatar
    return dataclasses.replace(
        avatar,
        cloud=avatar.cloud.select(kept),
        lbs_index=avatar.lbs_index[kept],
        lbs_weight=avatar.lbs_weight[kept],
    )
