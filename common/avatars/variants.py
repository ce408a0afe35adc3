"""More people from few avatars: other clothes, skin, hair, patterns and heights, for what learns to see people."""

import dataclasses
from pathlib import Path

import numpy as np

from readygo.common.arrays import Float64Array, Int64Array
from readygo.common.avatars.avatar import Avatar
from readygo.common.avatars.cast import load_cast
from readygo.common.avatars.file import save_avatar
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0

_COLOURS = 7
"""Groups of colours that are changed together: clothes, shoes, skin, hair."""
_ROUNDS = 12
_HEIGHT_WEIGHT = 0.6
"""How much a metre of height tells groups apart, beside colours of 0..1: shoes are no hair."""
_SCALE = (0.68, 1.14)
"""Smallest and largest change of size: children are people too."""
_BARE_JOINTS = (12, 15, 20, 21, 22, 23)
"""Neck, head, wrists and hands: skin and hair."""
_PATTERNED = 0.35
"""Share of the clothes that get a pattern."""


def write_variants(place: Path | None, out: Path, count: int, seed: int) -> list[Path]:
    """Files of varied avatars; those that are there already stay.

    Args:
        place: Avatars, see `readygo.common.avatars.cast`.
        out: Folder, made if it is missing.
        count: Number of avatars, each of the given ones in turn.
        seed: Seed of the changes.

    Raises:
        AvatarError: If there are no avatars, `count` is none, or `out` holds other files or cannot be written.
    """
    if count < 1 or seed < 0:
        raise AvatarError(f"--count must be at least 1 and --seed at least 0, got {count} and {seed}.")
    avatars = [avatar for _, avatar in sorted(load_cast(place).items())]
    chosen = [avatars[number % len(avatars)] for number in range(count)]
    paths = [out / f"{avatar.name}-{seed}-{number:03d}.npz" for number, avatar in enumerate(chosen)]
    if out.exists() and (not out.is_dir() or {*out.iterdir()} - {*paths}):
        raise AvatarError(f"{out} holds other files; choose a new or empty folder with --out.")
    for number, (avatar, path) in enumerate(zip(chosen, paths, strict=True)):
        if not path.exists():
            save_avatar(vary_avatar(avatar, path.stem, np.random.default_rng([seed, number])), path)
    return paths


def vary_avatar(avatar: Avatar, name: str, rng: np.random.Generator) -> Avatar:
    """An avatar that looks and is built differently, and moves as well.

    Args:
        avatar: The avatar.
        name: What the new one is called.
        rng: Draws what changes.
    """
    rgb = 0.5 + SH_C0 * avatar.cloud.sh[:, 0].astype(np.float64)
    means = avatar.cloud.means_m.astype(np.float64)
    groups = _groups(rgb, means[:, 1], rng)
    strongest = avatar.lbs_index[np.arange(len(means)), np.argmax(avatar.lbs_weight, axis=1)]
    bare = np.isin(strongest, _BARE_JOINTS)
    changed = rgb.copy()
    for group in range(_COLOURS):
        rows = groups == group
        if not rows.any():
            continue
        skin = bool(bare[rows].mean() > 0.5)
        changed[rows] = _recoloured(rgb[rows], means[rows], rng, skin=skin)
    sh = avatar.cloud.sh.copy()
    sh[:, 0] = ((np.clip(changed, 0.01, 0.99) - 0.5) / SH_C0).astype(np.float32)
    scale = float(rng.uniform(*_SCALE))
    return dataclasses.replace(
        avatar,
        name=name,
        height_m=avatar.height_m * scale,
        cloud=_scaled(dataclasses.replace(avatar.cloud, sh=sh), scale),
        joints_canonical_m=avatar.joints_canonical_m * np.float32(scale),
        joints_tpose_m=avatar.joints_tpose_m * np.float32(scale),
    )


def _scaled(cloud: GaussianCloud, scale: float) -> GaussianCloud:
    factor = np.float32(scale)
    return dataclasses.replace(cloud, means_m=cloud.means_m * factor, scales_m=cloud.scales_m * factor)


def _groups(rgb: Float64Array, height_m: Float64Array, rng: np.random.Generator) -> Int64Array:
    """Groups of Gaussians by colour and height (k-means), shape (N,)."""
    features = np.column_stack([rgb, _HEIGHT_WEIGHT * height_m])
    centres = features[rng.choice(len(features), _COLOURS, replace=False)]
    nearest = np.zeros(len(features), np.int64)
    for _ in range(_ROUNDS):
        squares = ((features[:, None] - centres[None]) ** 2).sum(axis=2)
        nearest = squares.argmin(axis=1)
        for group in range(_COLOURS):
            if (nearest == group).any():
                centres[group] = features[nearest == group].mean(axis=0)
    return nearest


def _recoloured(rgb: Float64Array, means: Float64Array, rng: np.random.Generator, *, skin: bool) -> Float64Array:
    """Another colour with the shades of the old one; clothes may get stripes."""
    shades = rgb - rgb.mean(axis=0)
    if skin:
        # Skin and hair: lighter or darker, a little redder or yellower.
        return rgb * rng.uniform(0.35, 1.5) * rng.uniform(0.9, 1.1, 3) + rng.uniform(-0.05, 0.1)
    base = rng.uniform(0.03, 0.95) + rng.uniform(-0.4, 0.4, 3) * rng.choice([0.2, 1.0])
    colour = np.clip(base, 0.02, 0.97) + shades * rng.uniform(0.5, 1.5)
    if rng.random() < _PATTERNED:
        other = rng.uniform(0.02, 0.97, 3)
        axis, width_m = rng.choice([0, 1, 1, 2]), rng.uniform(0.02, 0.12)
        striped = np.sin(2 * np.pi * means[:, axis] / (2 * width_m) + rng.uniform(0, 6)) > rng.uniform(-0.6, 0.6)
        colour[striped] = other + shades[striped]
    return np.asarray(colour, np.float64)
