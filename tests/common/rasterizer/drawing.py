"""Short ways to draw single views in tests."""

import math
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np

from readygo.common.arrays import Float32Array, Float64Array, FloatingArray, UInt8Array
from readygo.common.avatars import Avatar, pose_avatar
from readygo.common.gaussians import GaussianCloud, concatenate
from readygo.common.images.images import Images
from readygo.common.rasterizer.cpu.rasterizer import CpuRasterizer
from readygo.common.rasterizer.interface import PosedHuman, Rasterizer, View

T = TypeVar("T")


def numbered(avatars: Sequence[T]) -> dict[str, T]:
    """Avatars, or what is made of them, by the names "0", "1", ..."""
    return {str(number): avatar for number, avatar in enumerate(avatars)}


def images_of(
    rasterizer: Rasterizer,
    T_world_camera: Float64Array,
    humans: Sequence[PosedHuman] = (),
    outputs: Sequence[str] = ("rgb",),
) -> Images:
    """The images of one view."""
    return rasterizer.render([View(T_world_camera=T_world_camera, humans=humans)], outputs)[0]


def rgb_of(rasterizer: Rasterizer, T_world_camera: Float64Array, humans: Sequence[PosedHuman] = ()) -> UInt8Array:
    """The colours of one view."""
    return images_of(rasterizer, T_world_camera, humans).rgb


def float_rgb_of(rasterizer: Any, T_world_camera: Float64Array, humans: Sequence[PosedHuman] = ()) -> Float32Array:
    """The colours of one view before rounding."""
    view = View(T_world_camera=T_world_camera, humans=humans)
    if isinstance(rasterizer, CpuRasterizer):
        return rasterizer.render_float(view)
    (drawn,) = rasterizer._draw([view])
    image: Float32Array = drawn.rgb[0].cpu().numpy()
    return image


def batch_of(T_world_camera: Sequence[Float64Array], humans: Sequence[Sequence[PosedHuman]]) -> list[View]:
    """Views of several cameras, each with its own humans."""
    pairs = zip(T_world_camera, humans, strict=True)
    return [View(T_world_camera=pose, humans=there) for pose, there in pairs]


def psnr_db(a: FloatingArray, b: FloatingArray) -> float:
    """Of images of floats."""
    error = float(((a.astype(np.float64) - b) ** 2).mean())
    return math.inf if error == 0 else -10 * math.log10(error)


def human(x_m: float, y_m: float, *, avatar: int = 0, seed: int = 1) -> PosedHuman:
    """A human in a random pose at a place."""
    pose = 0.5 * np.random.default_rng(seed).normal(size=(24, 3))
    return PosedHuman(avatar=str(avatar), root_m=np.array([x_m, y_m, 1.0]), pose_axis_angle=pose)


def posed(cloud: GaussianCloud, avatars: Sequence[Avatar], humans: Sequence[PosedHuman]) -> GaussianCloud:
    """The scene and its humans as one cloud."""
    bodies = [pose_avatar(avatars[int(p.avatar)], p.root_m, p.pose_axis_angle) for p in humans]
    return concatenate([cloud, *bodies])


def assert_like_reference(image: Float32Array, reference: Float32Array) -> None:
    assert reference.max() > 0.1
    assert psnr_db(image, reference) > 60
    assert np.abs(image - reference).max() < 2 / 255


def with_arrays(cloud: GaussianCloud, **arrays: Float32Array) -> GaussianCloud:
    """The cloud with other arrays."""
    names = ("means_m", "quats_wxyz", "scales_m", "opacities", "sh")
    return GaussianCloud(**{name: arrays.get(name, getattr(cloud, name)) for name in names})
