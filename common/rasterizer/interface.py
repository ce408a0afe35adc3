"""One interface of all rasterizers: batches of views go in, images come out. The backends are made in `backends`."""

import itertools
from collections.abc import Container, Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import Protocol

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, FloatingArray
from readygo.common.errors import AvatarError
from readygo.common.gaussians import GaussianCloud
from readygo.common.images.images import Images, require_outputs
from readygo.common.rasterizer.constants import FEET_M

MAX_HUMANS = 255
"""Humans that a mask of bytes can tell apart."""


@dataclass(frozen=True, kw_only=True, eq=False)
class PosedHuman:
    """A human in one pose."""

    avatar: str
    """Name of the avatar."""
    root_m: FloatingArray
    """Pelvis in the z-up world [m], shape (3,)."""
    pose_axis_angle: FloatingArray
    """Joint rotations [rad] as in `Motion`, shape (24, 3)."""
    light: Float64Array | None = None
    """Light that falls on them, as in `readygo.common.gaussians.irradiance.irradiance_matrix`, shape (3, 4, 4); None
    draws them in the avatar's own colours."""
    ground_m: float = 0.0
    """World z of the ground below them [m]; matters where `lead_m` is not 0."""
    lead_m: float = 0.0
    """Feet on the ground are drawn before what is less than this behind them [m]; see `constants`."""

    def equals(self, other: "PosedHuman") -> bool:
        """True if both are the same human in the same pose.

        Args:
            other: Another one.
        """
        return (
            self.avatar == other.avatar
            and np.array_equal(self.root_m, other.root_m)
            and np.array_equal(self.pose_axis_angle, other.pose_axis_angle)
        )


@dataclass(frozen=True, kw_only=True, eq=False)
class View:
    """What one image shows: the scene from somewhere, with these humans in it."""

    T_world_camera: Float64Array
    """Camera pose, OpenCV axes, shape (4, 4)."""
    humans: Sequence[PosedHuman] = ()
    """Whom it shows; the mask numbers them from 1 in this order."""
    shadows: GaussianCloud | None = None
    """A few more Gaussians, made for this view; they are in its colours and in no other image of it."""
    K_px: Float64Array | None = None
    """Intrinsics [px] that replace the rasterizer's, for an image of the same size, shape (3, 3)."""


class PinholeCamera(Protocol):
    """What all views of a rasterizer are taken with; `CameraConfig` is one."""

    @property
    def K_px(self) -> Float64Array:
        """Intrinsics [px] without skew, shape (3, 3)."""
        ...

    @property
    def height_px(self) -> int:
        """Image height [px]."""
        ...

    @property
    def width_px(self) -> int:
        """Image width [px]."""
        ...


class Rasterizer(Protocol):
    """Draws views of one scene with one camera; not to be shared between threads."""

    @property
    def views_at_once(self) -> int:
        """How many views it likes to be given together: 1 where more gain nothing and cost memory."""
        ...

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        """The images of views.

        Args:
            views: V views.
            outputs: Names out of `readygo.common.images.images.OUTPUTS`; "rgb" is always made.

        Returns:
            Images with a first axis for the views; rgb has shape (V, H, W, 3).

        Raises:
            ValueError: If a view or a name cannot be used, or a mask of more than `MAX_HUMANS` humans is wanted.
            AvatarError: If a human wears an avatar that is not loaded.
            ReadygoError: If the backend does not make one of these images.
        """
        ...


def lead_terms(human: PosedHuman, R_CW: Float64Array, p_WC: Float64Array) -> Float32Array:
    """By how much a human's Gaussians are sorted as nearer [m]: max(0, min(a x + b y + c z + d, e)) of camera axes.

    Args:
        human: The human.
        R_CW: Maps directions from the world to the camera, shape (3, 3).
        p_WC: The camera in the world [m], shape (3,).

    Returns:
        a, b, c, d, e, shape (5,).
    """
    slope = human.lead_m / FEET_M
    a, b, c = (-slope * float(R_CW[k, 2]) for k in range(3))
    d = human.lead_m - slope * (float(p_WC[2]) - human.ground_m)
    return np.array([a, b, c, d, human.lead_m], dtype=np.float32)


def render_each(rasterizer: Rasterizer, wanted: Iterable[tuple[View, tuple[str, ...]]]) -> Iterator[Images]:
    """The images of one view after the other, drawn in batches as large as the rasterizer likes them.

    Args:
        rasterizer: Draws.
        wanted: Views and their outputs; taken from the iterable only when they are drawn.

    Yields:
        Images of single views, in their order.
    """
    remaining = iter(wanted)
    while batch := list(itertools.islice(remaining, rasterizer.views_at_once)):
        drawn: dict[int, Images] = {}
        for outputs in dict.fromkeys(names for _, names in batch):
            places = [place for place, (_, names) in enumerate(batch) if names == outputs]
            images = rasterizer.render([batch[place][0] for place in places], outputs)
            drawn |= {place: images[number] for number, place in enumerate(places)}
        yield from (drawn[place] for place in range(len(batch)))


def checked_outputs(views: Sequence[View], outputs: Sequence[str], avatars: Container[str]) -> frozenset[str]:
    """The names of the wanted images, after the checks that every backend makes; see `Rasterizer.render`."""
    wanted = require_outputs(outputs)
    for view in views:
        pose = np.asarray(view.T_world_camera)
        if pose.shape != (4, 4) or not np.isfinite(pose).all():
            raise ValueError(f"T_world_camera must be a finite 4x4 matrix, got {pose.tolist()}.")
        if "mask" in wanted and len(view.humans) > MAX_HUMANS:
            raise ValueError(f"a mask can tell {MAX_HUMANS} humans apart, got {len(view.humans)}.")
        for human in view.humans:
            _check_human(human, avatars)
    return wanted


def _check_human(human: PosedHuman, avatars: Container[str]) -> None:
    if human.avatar not in avatars:
        raise AvatarError(f"Avatar {human.avatar!r} is not loaded.")
    for name, shape in (("root_m", (3,)), ("pose_axis_angle", (24, 3))):
        array = getattr(human, name)
        if array.shape != shape or not np.isfinite(array).all():
            raise ValueError(f"{name} of a human must be finite, of shape {shape}; got {array.tolist()}.")
