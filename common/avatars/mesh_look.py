"""People as a game engine's simple assets: one flat colour per part of the body, no texture, the same bodies."""

import dataclasses

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.avatars.avatar import Avatar
from readygo.common.gaussians.irradiance import HARMONICS, add_radiance, irradiance_matrix
from readygo.common.gaussians.spherical_harmonics import rgb_of_sh, sh_of_rgb

BODY_PARTS = {
    "head": (12, 15),
    "torso": (0, 3, 6, 9, 13, 14),
    "arms": (16, 17, 18, 19),
    "hands": (20, 21, 22, 23),
    "legs": (1, 2, 4, 5),
    "feet": (7, 8, 10, 11),
}
"""Joints of SMPL by the part that they move."""


LIGHT_FROM = (0.4, 0.3, 0.866)
"""Direction to the only lamp, the same for all humans, in the world."""
LAMP, AMBIENT = 1.2, 0.6
"""Light on what faces the lamp, and on everything, next to which colours are as they are at 1."""


def fixed_light() -> Float64Array:
    """The lamp's Lambertian light, as in `irradiance_matrix`, shape (3, 4, 4)."""
    sh = np.zeros((HARMONICS, 3))
    lamp = np.full((1, 3), LAMP)
    add_radiance(lamp, np.array([LIGHT_FROM]), np.array([np.pi]), sh)
    light = irradiance_matrix(sh)
    light[:, 3, 3] += AMBIENT
    return light


def mesh_like(avatar: Avatar) -> Avatar:
    """An avatar whose Gaussians have their part's mean colour, the same from all sides.

    A part is all Gaussians that one of its joints moves most. Shape, size and opacity stay.
    """
    cloud = avatar.cloud
    rows = np.arange(len(cloud))
    leading = avatar.lbs_index[rows, avatar.lbs_weight.argmax(axis=1)]
    rgb = np.clip(rgb_of_sh(cloud.sh[:, 0]), 0.0, 1.0)
    flat = np.empty_like(rgb)
    for joints in BODY_PARTS.values():
        part = np.isin(leading, joints)
        if part.any():
            flat[part] = rgb[part].mean(axis=0)
    sh = sh_of_rgb(flat)[:, None].astype(np.float32)
    return dataclasses.replace(avatar, cloud=dataclasses.replace(cloud, sh=sh))
