"""Render requests: images of a scene with humans in it."""

from dataclasses import dataclass, field

import numpy as np

from readygo.common.arrays import AnyArray, Float64Array, UInt8Array
from readygo.common.messages.checks import check_array
from readygo.common.messages.codec import OMITTED_WHEN_DEFAULT
from readygo.common.messages.episode import EpisodeKey
from readygo.common.messages.motion import HumanMotion, Motion


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RenderView:
    """One camera at one simulated step of one episode."""

    people: str
    """Key of the humans to draw, as given in `RenderRequest.people` now or earlier; empty draws none."""
    step: int
    """Simulation step whose motion rows are drawn."""
    T_world_camera: Float64Array
    """Pose of the robot's first camera, OpenCV axes, shape (4, 4)."""
    episode: EpisodeKey | None = field(default=None, metadata=OMITTED_WHEN_DEFAULT)
    """The episode whose camera looks: what its sensor draws. None: the key of the humans stands for it."""
    path_xyyaw: tuple[tuple[float, float, float], ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """The robot at the latest steps: x [m], y [m], yaw [rad] (not wrapped), the last row at `step`, from where the
    camera has the pose above. Motion blur and rolling shutter need it; without, the camera stands still."""

    def __post_init__(self) -> None:
        check_array("T_world_camera", self.T_world_camera, np.float64, (4, 4))
        if any(len(row) != 3 for row in self.path_xyyaw):
            raise ValueError("path_xyyaw must have rows of x, y and yaw.")


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Humans:
    """Humans that later requests refer to by `key`."""

    key: str
    humans: tuple[HumanMotion, ...]


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RenderRequest:
    """A batch of views of the loaded scene with the robot's cameras."""

    views: tuple[RenderView, ...]
    people: tuple[Humans, ...] = ()
    """Humans that the renderer has not seen yet; it keeps the latest few hundred keys."""
    outputs: tuple[str, ...] = field(default=(), metadata=OMITTED_WHEN_DEFAULT)
    """Images besides rgb, see `readygo.common.images.names`."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class RenderReply:
    """Images in the order of the request's views."""

    rgb: UInt8Array
    """sRGB images, shape (B, H, W, 3)."""
    unknown_people: tuple[str, ...] = ()
    """Keys that the renderer does not hold (any more): send them along and ask again; `rgb` is then empty."""
    outputs: dict[str, AnyArray] = field(default_factory=dict, metadata=OMITTED_WHEN_DEFAULT)
    """The images besides rgb that were asked for, as in `readygo.common.images.images.Images`, shapes (B, H, W, ...)
    each."""

    def __post_init__(self) -> None:
        check_array("rgb", self.rgb, np.uint8, (None, None, None, 3))


__all__ = ["HumanMotion", "Humans", "Motion", "RenderReply", "RenderRequest", "RenderView"]
