"""Short ways to make single images in tests."""

from collections.abc import Sequence

from readygo.common.images.images import Images
from readygo.common.messages import HumanMotion
from readygo.services.renderer.capture import Capture, EpisodeCamera, MomentAt, Shot
from readygo.services.renderer.drawing import Drawing, Pose


def drawn(
    drawing: Drawing,
    T_world_camera: Pose,
    humans: Sequence[HumanMotion],
    step: float,
    outputs: Sequence[str] = ("rgb",),
) -> Images:
    """What the rasterizer makes of one view."""
    return drawing.rasterizer.render([drawing.view(T_world_camera, humans, step)], outputs)[0]


def taken(
    capture: Capture, camera: EpisodeCamera, moment_at: MomentAt, step: int, outputs: tuple[str, ...] = ("rgb",)
) -> Images:
    """What the sensor makes of one frame."""
    (images,) = capture.take([Shot(camera=camera, moment_at=moment_at, step=step)], outputs)
    return images
