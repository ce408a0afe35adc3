"""What a policy sees at one time: the images that it takes, side by side in the channels of one array.

| name | channels | what |
|---|---|---|
| `rgb` | 3 | the camera's colours |
| `depth` | 1 | how near things are: 255 at the camera, 1 at `depth_max_m`, 0 where nothing is measured |
"""

from collections.abc import Mapping, Sequence

import numpy as np
import numpy.typing as npt

from readygo.common.camera.config import CameraConfig
from readygo.common.camera.depth import depth_bytes, depth_rng, measured_depth

RGB, DEPTH = "rgb", "depth"
_CHANNELS: Mapping[str, int] = {RGB: 3, DEPTH: 1}
GRAPH_INPUTS: Mapping[str, str] = {RGB: "image", DEPTH: "depth"}
"""What an encoder's graph calls them."""

Sight = npt.NDArray[np.uint8]


def check_images(names: Sequence[str]) -> None:
    """Raise ValueError unless a policy can take these images together."""
    unknown = [name for name in names if name not in _CHANNELS]
    if unknown or len(set(names)) < len(names) or names[:1] != (RGB,):
        raise ValueError(f"images must be rgb, and after it any of {', '.join(_CHANNELS)} once, got {list(names)}.")


def channels_of(names: Sequence[str]) -> int:
    """Channels of some images side by side."""
    return sum(_CHANNELS[name] for name in names)


def channels_by_image(names: Sequence[str], frame_count: int = 1) -> dict[str, list[int]]:
    """Where each image is among the channels of some frames that are put one behind the other."""
    found: dict[str, list[int]] = {name: [] for name in names}
    channel = 0
    for _ in range(frame_count):
        for name in names:
            found[name] += range(channel, channel + _CHANNELS[name])
            channel += _CHANNELS[name]
    return found


def side_by_side(images: Mapping[str, Sight], names: Sequence[str]) -> Sight:
    """One array of some images, shape (..., H, W, C).

    Args:
        images: rgb, shape (..., H, W, 3), and bytes of depth (`readygo.common.camera.depth`), shape (..., H, W).
        names: Those that are wanted, in this order.
    """
    if tuple(names) == (RGB,):
        return images[RGB]
    parts = [images[name] if _CHANNELS[name] > 1 else images[name][..., None] for name in names]
    return np.concatenate(parts, axis=-1)


def camera_sight(
    rgb: Sight,
    depth_m: npt.NDArray[np.float32] | None,
    names: Sequence[str],
    camera: CameraConfig,
    name: str,
    step: int,
) -> Sight:
    """What a policy sees of an image that was drawn, its depths as the robot's camera measures them.

    Args:
        rgb: sRGB, shape (H, W, 3).
        depth_m: True depths [m], shape (H, W); None where no policy wants them.
        names: The images that it takes.
        camera: The robot's.
        name: Of the episode.
        step: At which the image was taken.

    Returns:
        Shape (H, W, C).
    """
    if tuple(names) == (RGB,):
        return rgb
    assert depth_m is not None
    measured_m = measured_depth(depth_m, camera, depth_rng(name, step))
    return side_by_side({RGB: rgb, DEPTH: depth_bytes(measured_m, camera)}, names)
