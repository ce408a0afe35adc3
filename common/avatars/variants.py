"""More people from few avatars: other clothes, skin, hair, patterns, builds and heights, to learn to see people."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array, Int64Array, UInt8Array
from readygo.common.avatars.avatar import SMPL_PARENTS, Avatar
from readygo.common.avatars.cast import load_cast
from readygo.common.avatars.file import save_avatar
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud
from readygo.common.gaussians.spherical_harmonics import SH_C0

_COLOURS = 6
"""Groups of colours of the clothes that are changed together."""
_ROUNDS = 12
_HEIGHT_WEIGHT = 0.6
"""How much a metre of height tells groups apart, beside colours of 0..1: shoes are no jacket."""
_SCALE = (0.68, 1.14)
"""Smallest and largest change of size: children are people too."""
_GIRTH = (0.82, 1.35)
"""Smallest and largest change of the girth of trunk and limbs, relative to the size."""
_PART_GIRTH = 0.1
"""Largest change of a part's girth beside that of the whole body."""
_HEAD, _HANDS, _FEET = 15, (22, 23), (7, 8, 10, 11)
_BARE_JOINTS = (4, 5, 7, 8, 12, 15, 18, 19, 20, 21, 22, 23)
"""Knees, ankles, neck, head, elbows, wrists and hands: where skin may show."""
_SKIN_DISTANCE = 0.08
"""Largest distance in hue from the hands (`_hues`) that is skin there; shadow is no other hue."""
_DARKEST_SKIN, _LIGHTEST_SKIN = (0.20, 0.12, 0.09), (0.93, 0.76, 0.66)
_HAIR = ((0.05, 0.04, 0.04), (0.18, 0.11, 0.07), (0.38, 0.24, 0.13), (0.75, 0.60, 0.36), (0.62, 0.62, 0.63))
"""Colours of hair: black, dark brown, brown, blond, grey."""
_MUTED = 0.6
"""Share of the garments in muted colours; the others have any."""
_PATTERNED = 0.35
"""Share of the garments that get stripes or checks."""


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
    strongest = avatar.lbs_index[np.arange(len(means)), np.argmax(avatar.lbs_weight, axis=1)]
    skin = _skin(rgb, strongest)
    hair = (strongest == _HEAD) & ~skin
    clothes = np.flatnonzero(~skin & ~hair)
    changed = rgb.copy()
    changed[skin] = _in_tone(rgb[skin], _between(_DARKEST_SKIN, _LIGHTEST_SKIN, rng.random()))
    changed[hair] = _in_tone(rgb[hair], np.array(_HAIR[rng.integers(len(_HAIR))]) * rng.uniform(0.8, 1.2))
    groups = _groups(rgb[clothes], means[clothes, 1], rng)
    for group in range(_COLOURS):
        rows = clothes[groups == group]
        if len(rows):
            changed[rows] = _garment(rgb[rows], means[rows], rng)
    sh = avatar.cloud.sh.copy()
    sh[:, 0] = ((np.clip(changed, 0.01, 0.99) - 0.5) / SH_C0).astype(np.float32)
    scale = float(rng.uniform(*_SCALE))
    built = _built(avatar, rng)
    return dataclasses.replace(
        avatar,
        name=name,
        height_m=avatar.height_m * scale,
        cloud=_scaled(dataclasses.replace(built, sh=sh), scale),
        joints_canonical_m=avatar.joints_canonical_m * np.float32(scale),
        joints_tpose_m=avatar.joints_tpose_m * np.float32(scale),
    )


def _scaled(cloud: GaussianCloud, scale: float) -> GaussianCloud:
    factor = np.float32(scale)
    return dataclasses.replace(cloud, means_m=cloud.means_m * factor, scales_m=cloud.scales_m * factor)


def _built(avatar: Avatar, rng: np.random.Generator) -> GaussianCloud:
    """The Gaussians further from their bones or nearer to them; head, hands and feet stay as they are."""
    girth = rng.uniform(*_GIRTH) * rng.uniform(1.0 - _PART_GIRTH, 1.0 + _PART_GIRTH, len(SMPL_PARENTS))
    girth[[_HEAD, *_HANDS, *_FEET]] = 1.0
    joints = avatar.joints_canonical_m.astype(np.float64)
    axes = _bone_axes(joints)
    means, moved = avatar.cloud.means_m.astype(np.float64), np.zeros_like(avatar.cloud.means_m, np.float64)
    for index, weight in zip(avatar.lbs_index.T, avatar.lbs_weight.T.astype(np.float64), strict=True):
        away = means - joints[index]
        away -= axes[index] * (away * axes[index]).sum(axis=1, keepdims=True)
        moved += (weight * (girth[index] - 1.0))[:, None] * away
    wider = (avatar.lbs_weight * girth[avatar.lbs_index]).sum(axis=1, keepdims=True)
    return dataclasses.replace(
        avatar.cloud,
        means_m=(means + moved).astype(np.float32),
        scales_m=avatar.cloud.scales_m * np.maximum(wider, 1.0).astype(np.float32),
    )


def _bone_axes(joints: Float64Array) -> Float64Array:
    """Unit vectors along the bone of each joint, towards its children or away from its parent, shape (24, 3)."""
    axes = np.empty_like(joints)
    for joint, parent in enumerate(SMPL_PARENTS):
        children = np.flatnonzero(joint == SMPL_PARENTS)
        axes[joint] = joints[children].mean(axis=0) - joints[joint] if len(children) else joints[joint] - joints[parent]
    axes /= np.maximum(np.linalg.norm(axes, axis=1, keepdims=True), 1e-6)
    return axes


def _skin(rgb: Float64Array, strongest: UInt8Array) -> BoolArray:
    """True for the Gaussians that show skin: those of the hands' colour, where clothes may leave it bare."""
    hands = np.isin(strongest, _HANDS)
    if not hands.any():
        return hands
    hues, lightness = _hues(rgb), rgb.mean(axis=1)
    near = np.linalg.norm(hues - np.median(hues[hands], axis=0), axis=1) < _SKIN_DISTANCE
    near &= lightness > 0.4 * np.median(lightness[hands])
    skin: BoolArray = hands | (near & np.isin(strongest, _BARE_JOINTS))
    return skin


def _hues(rgb: Float64Array) -> Float64Array:
    """Shares of red and green in the colours: the same in light and shadow, shape (N, 2)."""
    return np.asarray(rgb[:, :2] / (rgb.sum(axis=1, keepdims=True) + 0.1), np.float64)


def _between(low: Sequence[float], high: Sequence[float], share: float) -> Float64Array:
    return np.asarray(np.array(low) + share * (np.array(high) - np.array(low)), np.float64)


def _in_tone(rgb: Float64Array, tone: Float64Array) -> Float64Array:
    """Another mean colour with the shades of the old one, as factors."""
    if not len(rgb):
        return rgb
    lightness = rgb.mean(axis=1, keepdims=True)
    return np.asarray(tone * np.clip(lightness / max(lightness.mean(), 0.02), 0.2, 1.8), np.float64)


def _groups(rgb: Float64Array, height_m: Float64Array, rng: np.random.Generator) -> Int64Array:
    """Groups of Gaussians by colour and height (k-means), shape (N,)."""
    features = np.column_stack(
        [rgb[:, 0] - rgb[:, 1], rgb[:, 1] - rgb[:, 2], 0.5 * rgb.mean(axis=1), _HEIGHT_WEIGHT * height_m]
    )
    count = min(_COLOURS, len(features))
    centres = features[rng.choice(len(features), count, replace=False)]
    nearest = np.zeros(len(features), np.int64)
    for _ in range(_ROUNDS):
        squares = ((features[:, None] - centres[None]) ** 2).sum(axis=2)
        nearest = squares.argmin(axis=1) if count else nearest
        for group in range(count):
            if (nearest == group).any():
                centres[group] = features[nearest == group].mean(axis=0)
    return nearest


def _garment(rgb: Float64Array, means: Float64Array, rng: np.random.Generator) -> Float64Array:
    """Another colour with the shades of the old one; stripes or checks on some."""
    shades = rgb - rgb.mean(axis=0)
    colour = np.clip(_colour(rng), 0.02, 0.97) + shades * rng.uniform(0.5, 1.5)
    if rng.random() < _PATTERNED:
        other, crossed = _colour(rng), rng.random() < 0.4
        wide_m, phase, level = rng.uniform(0.02, 0.12), rng.uniform(0, 6, 2), rng.uniform(-0.6, 0.6)
        axes = (1, rng.choice([0, 2])) if crossed else (rng.choice([0, 1, 1, 2]),)
        waves = [np.sin(np.pi * means[:, axis] / wide_m + start) for axis, start in zip(axes, phase, strict=False)]
        marked = np.max(waves, axis=0) > level + 0.5 * crossed
        colour[marked] = np.clip(other, 0.02, 0.97) + shades[marked]
    return np.asarray(colour, np.float64)


def _colour(rng: np.random.Generator) -> Float64Array:
    """A colour of clothes, about 0..1: light or dark, mostly muted."""
    lightness = rng.uniform(0.03, 0.95)
    vivid = 1.0 if rng.random() > _MUTED else 0.2
    return np.asarray(lightness + vivid * rng.uniform(-0.4, 0.4, 3), np.float64)
