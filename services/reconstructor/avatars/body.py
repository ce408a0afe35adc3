"""The body that a fit begins with: the embedded avatar whose silhouettes are most like the person's.

Its skeleton begins as the mean of all bodies' skeletons, those of more similar bodies with more weight: a silhouette
shows little of where joints lie, and a single body may have them elsewhere.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import BoolArray, Float64Array
from readygo.common.avatars import Avatar
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman, View
from readygo.common.rasterizer.packed.avatar import PackedAvatar, pack_avatar
from readygo.services.reconstructor.avatars.views import FilmedPerson, PersonView, view_at

_FRAMES, _FRACTION = 6, 2
_SIZE_LIMITS = 0.6, 1.6
_ROUNDS = 2
OVERLAP_SCALE = 0.01
"""A body whose overlap is so much less than the best one's has 1/e of its weight. Of m1_casual, f2_office and f1_sport
the weighted mean of the skeletons is 1.4, 1.4 and 1.8 cm off, that of the best body alone 1.6, 1.8 and 2.2 cm, the mean
of all 1.9, 1.2 and 1.9 cm."""
OVERLAP_MIN = 0.35
"""Silhouettes that have less in common than this share of their union are of other poses or cameras."""


@dataclass(frozen=True, kw_only=True, eq=False)
class LikeBody:
    """A body at the person's size."""

    body: Avatar
    overlap: float
    """Share of the silhouettes' union that is common."""


def compare_bodies(
    bodies: Mapping[str, Avatar], person: FilmedPerson, pose: Float64Array, root_m: Float64Array
) -> list[LikeBody]:
    """Bodies at the person's size, the one that fits best first.

    Args:
        bodies: Avatars by name.
        person: The film.
        pose: Poses, shape (F, 24, 3).
        root_m: Pelvises [m], shape (F, 3).
    """
    frames = some_frames(person)
    found = []
    for name in sorted(bodies):
        body, tried = bodies[name], []
        for _ in range(_ROUNDS + 1):
            overlap, ratio = _compare(body, person, frames, pose, root_m)
            tried.append(LikeBody(body=body, overlap=overlap))
            body = scale_body(body, float(np.clip(ratio, *_SIZE_LIMITS)))
        found.append(max(tried, key=lambda each: each.overlap))
    return sorted(found, key=lambda each: -each.overlap)


def weights_of(bodies: Sequence[LikeBody]) -> Float64Array:
    """Weights of bodies in a mean, by their overlaps; their sum is 1."""
    overlaps = np.array([each.overlap for each in bodies])
    shares = np.exp((overlaps - overlaps.max()) / OVERLAP_SCALE)
    weights: Float64Array = shares / shares.sum()
    return weights


def scale_body(body: Avatar, factor: float) -> Avatar:
    """The same body, larger or smaller."""
    scale = np.float32(factor)
    cloud = dataclasses.replace(body.cloud, means_m=body.cloud.means_m * scale, scales_m=body.cloud.scales_m * scale)
    return dataclasses.replace(
        body,
        cloud=cloud,
        height_m=body.height_m * factor,
        joints_canonical_m=body.joints_canonical_m * scale,
        joints_tpose_m=body.joints_tpose_m * scale,
    )


def _compare(
    body: Avatar, person: FilmedPerson, frames: list[int], pose: Float64Array, root_m: Float64Array
) -> tuple[float, float]:
    """Common share of the silhouettes, and the ratio of the person's size in the image to the body's."""
    both, either, ratios = 0, 0, []
    packed = pack_avatar(body)
    for frame in frames:
        view = view_at(person, frame, _FRACTION)
        drawn = silhouette(body, packed, view, pose[frame], root_m[frame])
        mask = view.mask > 0.5
        both += int((drawn & mask).sum())
        either += int((drawn | mask).sum())
        if drawn.any() and mask.any():
            ratios.append(_extent(mask) / _extent(drawn))
    return both / max(either, 1), float(np.median(ratios)) if ratios else 1.0


def silhouette(
    body: Avatar, packed: PackedAvatar, view: PersonView, pose: Float64Array, root_m: Float64Array
) -> BoolArray:
    """Where a body covers most of a pixel of a view, shape (H, W).

    Args:
        body: The body.
        packed: The body as `pack_avatar` packs it, which costs more than drawing it.
        view: The camera, and the size of its image.
        pose: Rotations of the joints, shape (24, 3).
        root_m: The pelvis [m], shape (3,).
    """
    human = PosedHuman(avatar=body.name, root_m=root_m, pose_axis_angle=pose)
    drawer = CpuRasterizer([], {body.name: body}, view.K_px, *view.mask.shape, packed_avatars={body.name: packed})
    images = drawer.render([View(T_world_camera=view.T_world_camera, humans=(human,))], ("alpha",))[0]
    assert images.alpha is not None
    return np.asarray(images.alpha > 0.5)


def _extent(mask: BoolArray) -> float:
    """Spread of a silhouette along the rows: insensitive to single pixels."""
    rows = np.nonzero(mask)[0]
    return float(np.std(rows)) + 1e-6


def overlap_of(body: Avatar, person: FilmedPerson, pose: Float64Array, root_m: Float64Array) -> float:
    """Common share of the silhouettes of a body and of the person, in some frames."""
    return _compare(body, person, some_frames(person), pose, root_m)[0]


def swap_sides(pose: Float64Array) -> Float64Array:
    """Poses whose left joints have the rotations of the right ones, shape (F, 24, 3)."""
    left, out = np.array([1, 4, 7, 10, 13, 16, 18, 20, 22]), pose.copy()
    out[:, left], out[:, left + 1] = pose[:, left + 1], pose[:, left]
    return out


def some_frames(person: FilmedPerson) -> list[int]:
    """Frames that bodies are compared in, spread evenly."""
    frames: list[int] = np.unique(np.linspace(0, len(person) - 1, _FRAMES).astype(int)).tolist()
    return frames
