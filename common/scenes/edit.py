"""Changing a scene's Gaussians before its maps are made: cropping, cleaning, levelling, scaling, mirroring."""

import math
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array
from readygo.common.errors import NoGroundError, SceneError
from readygo.common.gaussians import GaussianCloud, R_from_up, sh_basis, transform_cloud
from readygo.common.gaussians.defects import FLOATERS, HAZE, HUGE, count_kinds, unwanted_masks, without
from readygo.common.scenes.survey import ROOM_HEIGHT_M, Survey, UpCandidate, survey

KINDS = (HUGE, FLOATERS, HAZE)
LEVEL_MAX_DEG = 45.0
"""A floor that is tilted by more is found by `--up auto` on import, not by levelling."""


@dataclass(frozen=True, kw_only=True)
class Box:
    """A part of the world [m]; sides that are not given are open."""

    low: tuple[float, float, float] = (-math.inf,) * 3
    high: tuple[float, float, float] = (math.inf,) * 3

    def __post_init__(self) -> None:
        if not all(a < b for a, b in zip(self.low, self.high, strict=True)):
            raise SceneError(f"A box to crop to needs its low corner below its high one, got {self}.")

    def __str__(self) -> str:
        ranges = zip("xyz", self.low, self.high, strict=True)
        return ", ".join(
            f"{axis} {low:g}..{high:g} m" for axis, low, high in ranges if (low, high) != (-math.inf, math.inf)
        )


def crop_box(xy: tuple[float, float, float, float] | None, z: tuple[float, float] | None) -> Box | None:
    """The box of x0 y0 x1 y1 and z0 z1 [m], either of which may be missing.

    Raises:
        SceneError: If it is empty.
    """
    if xy is None and z is None:
        return None
    x0, y0, x1, y1 = xy or (-math.inf, -math.inf, math.inf, math.inf)
    z0, z1 = z or (-math.inf, math.inf)
    return Box(low=(x0, y0, z0), high=(x1, y1, z1))


def crop_cloud(cloud: GaussianCloud, box: Box) -> GaussianCloud:
    """The Gaussians whose centres lie in a box.

    Raises:
        SceneError: If there are none.
    """
    kept = np.asarray(((cloud.means_m >= np.array(box.low)) & (cloud.means_m <= np.array(box.high))).all(axis=1))
    if not kept.any():
        low, high = np.quantile(cloud.means_m, [0.01, 0.99], axis=0)
        extent = ", ".join(f"{axis} {a:.1f}..{b:.1f}" for axis, a, b in zip("xyz", low, high, strict=True))
        raise SceneError(f"Nothing is left of the scene within {box}; it lies at {extent} m.")
    return cloud.select(kept)


def clean_cloud(cloud: GaussianCloud, kinds: tuple[str, ...]) -> tuple[GaussianCloud, str]:
    """The cloud without some kinds of unwanted Gaussians, and how many there were of each.

    Raises:
        SceneError: If a kind is unknown, or nothing would be left.
    """
    unknown = sorted(set(kinds) - set(KINDS))
    if unknown or not kinds:
        raise SceneError(f"Unknown kind of Gaussians {', '.join(unknown)!r}; known: {', '.join(KINDS)}.")
    masks = {kind: mask for kind, mask in unwanted_masks(cloud).items() if kind in kinds}
    kept, _ = without(cloud, masks)
    if len(kept) == 0:
        raise SceneError(f"Nothing would be left of the scene without {count_kinds(masks)}.")
    return kept, count_kinds(masks)


def levelling(cloud: GaussianCloud, up: str) -> tuple[Float64Array, Float64Array, str]:
    """The motion that makes a floor level and puts it at height 0: rotation (3, 3), translation (3,) [m], and up.

    Args:
        cloud: Gaussians.
        up: A direction as of `R_from_up`, or "auto" for that of the floor, which must be near +z.

    Raises:
        SceneError: If there is no such floor.
    """
    found = survey(cloud)
    if up == "auto":
        floor = _near_floor(found)
        up = ",".join(f"{value:.6f}" for value in floor.up)
    R = R_from_up(up)
    height = _lowest_floor(survey(transform_cloud(cloud, R)))
    return R, np.array([0.0, 0.0, -height]), up


def _near_floor(found: Survey) -> UpCandidate:
    near = [up for up in found.ups if up.up[2] > math.cos(math.radians(LEVEL_MAX_DEG))]
    if not near:
        raise NoGroundError("No plane of the scene within 45 deg of level looks like a floor; give its --up.")
    return near[0]


def _lowest_floor(found: Survey) -> float:
    return _near_floor(found).floor


def room_scale(cloud: GaussianCloud, room_height_m: float = ROOM_HEIGHT_M) -> float:
    """The factor that gives a room its height.

    Raises:
        SceneError: If no room with a ceiling is found.
    """
    ceiling = _near_floor(survey(cloud)).ceiling
    if ceiling is None:
        raise SceneError("No ceiling is found in the scene; give the scale as --factor.")
    return room_height_m / ceiling


def mirror_cloud(cloud: GaussianCloud) -> GaussianCloud:
    """The mirror image of a cloud: x becomes -x, in places, orientations and view-dependent colour."""
    flip = np.array([-1.0, 1.0, 1.0])
    directions = np.array([[0.36, 0.48, 0.8]])
    parity = np.sign(sh_basis(directions * flip, cloud.sh_degree) * sh_basis(directions, cloud.sh_degree))[0]
    return GaussianCloud(
        means_m=(cloud.means_m * flip).astype(np.float32),
        quats_wxyz=cloud.quats_wxyz * np.array([1.0, 1.0, -1.0, -1.0], np.float32),
        scales_m=cloud.scales_m,
        opacities=cloud.opacities,
        sh=(cloud.sh * parity[:, None]).astype(np.float32),
    )
