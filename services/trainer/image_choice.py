"""The images that a policy uses, from the options --inputs and --cameras."""

from readygo.common.errors import ConfigError
from readygo.common.images.names import RGB, images_of
from readygo.common.policy.sight import check_cameras, check_images
from readygo.common.robot import RobotConfig


def chosen_images(inputs: str, cameras: str, robot: RobotConfig) -> tuple[str, ...]:
    """The names of the images that a policy uses, as in `readygo.common.images.names`.

    Args:
        inputs: Kinds of images, separated by commas; rgb if empty.
        cameras: Names of the robot's cameras, separated by commas; the first one if empty.
        robot: Robot with the cameras.

    Raises:
        ConfigError: If there is no such kind or camera, the first camera is left out, or the cameras' images have
            different sizes.
    """
    kinds, first = _split(inputs) or [RGB], robot.camera_name
    names = _split(cameras) or [first]
    unknown = [name for name in names if name not in robot.all_cameras]
    if unknown:
        raise ConfigError(f"--cameras: the robot has no camera {unknown[0]!r}; it has {', '.join(robot.all_cameras)}.")
    if first not in names:
        raise ConfigError(f"--cameras must have {first!r} among them, the robot's first camera, got {cameras!r}.")
    images = images_of(["", *(name for name in names if name != first)], kinds)
    try:
        check_images(images)
        check_cameras(images, robot)
    except ValueError as error:
        raise ConfigError(f"--inputs and --cameras: {error}") from error
    return images


def _split(words: str) -> list[str]:
    return [word.strip() for word in words.split(",")] if words else []
