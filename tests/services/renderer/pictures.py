"""Short ways to make single images in tests."""

from collections.abc import Sequence

from readygo.common.arrays import Float64Array
from readygo.common.images.images import Images
from readygo.common.messages import HumanMotion
from readygo.common.rasterizer.interface import Rasterizer, View
from readygo.services.renderer import Renderer, Shot
from readygo.services.renderer.camera import PoseAt


def drawn(
    renderer: Renderer,
    T_world_camera: Float64Array,
    humans: Sequence[HumanMotion],
    step: int,
    outputs: tuple[str, ...] = ("rgb",),
) -> Images:
    """What the first camera shows of one view in which nothing moves."""
    return taken(renderer, lambda *_: T_world_camera, step, outputs, humans=humans, still=True)


def taken(
    renderer: Renderer,
    pose_at: PoseAt,
    step: int,
    outputs: tuple[str, ...] = ("rgb",),
    *,
    humans: Sequence[HumanMotion] = (),
    still: bool = False,
) -> Images:
    """What the first camera records at one step."""
    shot = Shot(step=step, pose_at=pose_at, humans=tuple(humans), still=still)
    (images,) = renderer.draw("", [shot], outputs)
    return images


class Watched:
    """A rasterizer that keeps the views that it draws, and their images."""

    views_at_once = 1

    def __init__(self, rasterizer: Rasterizer) -> None:
        self.rasterizer, self.views, self.images = rasterizer, [], []

    def render(self, views: Sequence[View], outputs: Sequence[str] = ("rgb",)) -> Images:
        images = self.rasterizer.render(views, outputs)
        self.views += views
        self.images += [images[number] for number in range(len(views))]
        return images


def view_of(renderer: Renderer, T_world_camera: Float64Array, humans: Sequence[HumanMotion], step: float) -> View:
    """What the first camera's rasterizer draws of one view in which nothing moves."""
    rasterizer = renderer.rasterizers[""]
    renderer.rasterizers[""] = watched = Watched(rasterizer)
    drawn(renderer, T_world_camera, humans, step)
    renderer.rasterizers[""] = rasterizer
    (view,) = watched.views
    return view
