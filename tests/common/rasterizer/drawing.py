"""Short ways to draw single views in tests."""

from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
import numpy.typing as npt

from readygo.common.images.images import Images
from readygo.common.rasterizer.interface import PosedHuman, Rasterizer, View

T = TypeVar("T")


def numbered(avatars: Sequence[T]) -> dict[str, T]:
    """Avatars, or what is made of them, by the names "0", "1", ..."""
    return {str(number): avatar for number, avatar in enumerate(avatars)}


def images_of(
    rasterizer: Rasterizer,
    T_world_camera: npt.NDArray[np.float64],
    humans: Sequence[PosedHuman] = (),
    outputs: Sequence[str] = ("rgb",),
) -> Images:
    """The images of one view."""
    return rasterizer.render([View(T_world_camera=T_world_camera, humans=humans)], outputs)[0]


def rgb_of(
    rasterizer: Rasterizer, T_world_camera: npt.NDArray[np.float64], humans: Sequence[PosedHuman] = ()
) -> npt.NDArray[np.uint8]:
    """The colours of one view."""
    return images_of(rasterizer, T_world_camera, humans).rgb


def float_rgb_of(
    rasterizer: Any, T_world_camera: npt.NDArray[np.float64], humans: Sequence[PosedHuman] = ()
) -> npt.NDArray[np.float32]:
    """The colours of one view before rounding."""
    image: npt.NDArray[np.float32] = rasterizer.render_float(View(T_world_camera=T_world_camera, humans=humans))
    return image


def batch_of(T_world_camera: Sequence[npt.NDArray[np.float64]], humans: Sequence[Sequence[PosedHuman]]) -> list[View]:
    """Views of several cameras, each with its own humans."""
    pairs = zip(T_world_camera, humans, strict=True)
    return [View(T_world_camera=pose, humans=there) for pose, there in pairs]
