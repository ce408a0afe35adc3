"""What a policy sees at one time: the images that it takes, side by side in the channels of one array.

| kind | channels | what |
|---|---|---|
| `rgb` | 3 | the camera's colours |
| `depth` | 1 | how near things are: 255 at the camera, 1 at `depth_max_m`, 0 where nothing is measured |

Images of cameras besides the first carry the camera's name before a point, see `readygo.common.images.names`; the
cameras that a policy sees with have images of one size.
"""

from collections.abc import Mapping, Sequence

import numpy as np

from readygo.common.arrays import AnyArray, UInt8Array
from readygo.common.camera.config import CameraConfig
from readygo.common.camera.depth import depth_bytes, depth_rng, measured_depth
from readygo.common.images.names import DEPTH, RGB, camera_of, cameras_of, image_name, kind_of, kinds_of
from readygo.common.robot.config import RobotConfig

_CHANNELS: Mapping[str, int] = {RGB: 3, DEPTH: 1}


def check_images(names: Sequence[str]) -> None:
    """Raise ValueError unless a policy can take these images together: camera by camera, rgb first."""
    known = all(kind_of(name) in _CHANNELS for name in names) and names[:1] == (RGB,)
    ordered = tuple(image_name(camera, kind) for camera in cameras_of(names) for kind in kinds_of(camera, names))
    begun = all(kinds_of(camera, names)[0] == RGB for camera in cameras_of(names))
    if not known or not begun or len(set(names)) < len(names) or ordered != tuple(names):
        raise ValueError(
            f"images must be, camera by camera, rgb and after it any of {', '.join(_CHANNELS)} once, got {list(names)}."
        )


def check_cameras(names: Sequence[str], robot: RobotConfig) -> None:
    """Raise ValueError unless a robot has the cameras of some images, all of one size."""
    for camera in cameras_of(names):
        if camera and camera not in robot.cameras:
            raise ValueError(f"the robot has no camera {camera!r}; it has {', '.join(robot.all_cameras)}.")
        ours, first = camera_on(robot, camera), robot.camera
        if (ours.height_px, ours.width_px) != (first.height_px, first.width_px):
            raise ValueError(
                f"cameras that a policy sees with have images of one size: {robot.camera_name!r} has "
                f"{first.height_px}x{first.width_px} px, {camera!r} {ours.height_px}x{ours.width_px}."
            )


def camera_on(robot: RobotConfig, camera: str) -> CameraConfig:
    """A robot's camera by its name; the first one is called ""."""
    return robot.cameras[camera] if camera else robot.camera


def channels_of(names: Sequence[str]) -> int:
    """Channels of some images side by side."""
    return sum(_CHANNELS[kind_of(name)] for name in names)


def channels_by_image(names: Sequence[str], frame_count: int = 1) -> dict[str, list[int]]:
    """Where each image is among the channels of some frames that are put one behind the other."""
    found: dict[str, list[int]] = {name: [] for name in names}
    channel = 0
    for _ in range(frame_count):
        for name in names:
            count = _CHANNELS[kind_of(name)]
            found[name] += range(channel, channel + count)
            channel += count
    return found


def side_by_side(images: Mapping[str, UInt8Array], names: Sequence[str]) -> UInt8Array:
    """One array of some images, shape (..., H, W, C).

    Args:
        images: By name: rgb, shape (..., H, W, 3), and bytes of depth (`readygo.common.camera.depth`), shape
            (..., H, W).
        names: Those that are wanted, in this order.
    """
    if tuple(names) == (RGB,):
        return images[RGB]
    parts = [images[name] if kind_of(name) == RGB else images[name][..., None] for name in names]
    return np.concatenate(parts, axis=-1)


def as_measured(image: AnyArray, name: str, robot: RobotConfig, episode: str, step: int) -> AnyArray:
    """An image that was drawn as the robot's camera gives it: depths as it measures them, colours as they are.

    Args:
        image: sRGB, shape (H, W, 3), or true depths [m], shape (H, W).
        name: Which image it is.
        robot: Whose camera looks.
        episode: Name of the episode.
        step: At which the image was taken.
    """
    if kind_of(name) == RGB:
        return image
    camera = camera_of(name)
    return measured_depth(image, camera_on(robot, camera), depth_rng(image_name(camera, episode), step))


def in_bytes(image: AnyArray, name: str, robot: RobotConfig) -> UInt8Array:
    """A measured image as policies take it.

    Args:
        image: sRGB, shape (..., H, W, 3), or measured depths [m], shape (..., H, W).
        name: Which image it is.
        robot: Whose camera measured.
    """
    return image if kind_of(name) == RGB else depth_bytes(image, camera_on(robot, camera_of(name)))


def robot_sight(
    drawn: Mapping[str, AnyArray], names: Sequence[str], robot: RobotConfig, episode: str, step: int
) -> UInt8Array:
    """What a policy sees of images that were drawn, shape (H, W, C); see `as_measured`.

    Args:
        drawn: Images by name, those of `names` among them.
        names: The images that it takes.
        robot: Whose cameras look.
        episode: Name of the episode.
        step: At which the images were taken.
    """
    measured = {name: as_measured(drawn[name], name, robot, episode, step) for name in names}
    return side_by_side({name: in_bytes(image, name, robot) for name, image in measured.items()}, names)
