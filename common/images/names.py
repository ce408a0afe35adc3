"""Names of a robot's images: `rgb`, `depth`, ... of its first camera, `left.rgb`, `left.depth`, ... of another."""

from collections.abc import Iterable, Sequence

RGB, DEPTH, MEDIAN_DEPTH = "rgb", "depth", "median_depth"
GOAL_IMAGE = "goal_image"
"""What the first camera shows at the goal; an episode has one."""
SHOWN_KINDS = (RGB, DEPTH)
"""Kinds of images that people are shown."""


def image_name(camera: str, kind: str) -> str:
    """The name of an image.

    Args:
        camera: The camera's name; empty for the first one.
        kind: One of `readygo.common.images.images.OUTPUTS`.
    """
    return f"{camera}.{kind}" if camera else kind


def camera_of(name: str) -> str:
    """The camera of an image; empty for the first one."""
    return name.rpartition(".")[0]


def kind_of(name: str) -> str:
    """What an image is of, one of `readygo.common.images.images.OUTPUTS`."""
    return name.rpartition(".")[2]


def kinds_of(camera: str, names: Iterable[str]) -> tuple[str, ...]:
    """What is asked of one camera among the images of several."""
    return tuple(kind_of(name) for name in names if camera_of(name) == camera)


def cameras_of(names: Iterable[str]) -> tuple[str, ...]:
    """The cameras of some images, each once, in the order of the images."""
    return tuple(dict.fromkeys(map(camera_of, names)))


def images_of(cameras: Sequence[str], kinds: Sequence[str]) -> tuple[str, ...]:
    """The images of some kinds of each camera, camera by camera; the first camera is called ""."""
    return tuple(image_name(camera, kind) for camera in cameras for kind in kinds)
