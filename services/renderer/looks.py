"""Looking around in a scene with the robot's camera, without people: whether there is anything to see."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from readygo.common.arrays import Float64Array, UInt8Array
from readygo.common.episode import EpisodeConfig
from readygo.common.images.clarity import CLARITY_OUTPUTS, coverage, sharpness
from readygo.common.images.names import RGB
from readygo.common.messages import EpisodeKey
from readygo.services.renderer.camera import Shot, path_poses
from readygo.services.renderer.renderer import Renderer
from readygo.services.renderer.samples import encode_image

LOOKS_PER_EPISODE = 5
BLURRED, BARE = "blurred view", "too little in view"
"""Why an episode is rejected, see `EpisodeConfig.sharpness_min` and `coverage_min`."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What the robot's camera shows from one pose."""

    xyyaw: tuple[float, float, float]
    """Pose of the robot: x, y [m], yaw [rad]."""
    rgb: UInt8Array
    """sRGB image, shape (H, W, 3)."""
    sharpness: float
    coverage: float


def look_around(renderer: Renderer, xyyaw: Float64Array, episode: EpisodeKey | None = None) -> Iterator[Look]:
    """What the robot's camera shows, one pose after the other; equal poses look equal.

    Args:
        renderer: Scene and camera.
        xyyaw: Poses of the robot: x, y [m], yaw [rad], shape (N, 3).
        episode: Whose camera looks; None takes one of no episode.

    Raises:
        RunError: If the renderer's backend makes no depths.
    """
    shots = [_shot(renderer, pose, episode) for pose in xyyaw]
    for pose, images in zip(xyyaw, renderer.draw("", shots, CLARITY_OUTPUTS), strict=True):
        x_m, y_m, yaw_rad = (float(value) for value in pose)
        yield Look(
            xyyaw=(x_m, y_m, yaw_rad), rgb=images.rgb, sharpness=sharpness(images.rgb), coverage=coverage(images)
        )


def goal_view(renderer: Renderer, episode: EpisodeKey, xyyaw: tuple[float, float, float]) -> UInt8Array:
    """What the first camera of an episode shows at its goal without humans, sRGB, shape (H, W, 3).

    Args:
        renderer: Scene and camera.
        episode: Whose camera looks.
        xyyaw: How the robot stands at the goal: x, y [m], yaw [rad].
    """
    (images,) = renderer.draw("", [_shot(renderer, np.array(xyyaw), episode)], (RGB,))
    return images.rgb


def goal_picture(renderer: Renderer, episode: EpisodeKey, xyyaw: tuple[float, float, float]) -> bytes:
    """What `goal_view` shows, encoded as an episode's images are."""
    return encode_image(goal_view(renderer, episode, xyyaw), renderer.config)


def unclear(renderer: Renderer, episode: EpisodeKey, xyyaw: Float64Array, config: EpisodeConfig) -> str:
    """Why an episode shows too little to be recorded; empty if it shows enough or no limit is set.

    A few views, spread evenly over its steps, are drawn without people; their medians are compared.

    Args:
        renderer: Scene and camera.
        episode: Whose camera looks.
        xyyaw: Where the robot goes: x, y [m], yaw [rad], shape (T, 3).
        config: With the limits.
    """
    if config.sharpness_min == config.coverage_min == 0.0:
        return ""
    steps = len(xyyaw) * (2 * np.arange(LOOKS_PER_EPISODE) + 1) // (2 * LOOKS_PER_EPISODE)
    looks = list(look_around(renderer, xyyaw[steps], episode))
    if np.median([look.sharpness for look in looks]) < config.sharpness_min:
        return BLURRED
    return BARE if np.median([look.coverage for look in looks]) < config.coverage_min else ""


def _shot(renderer: Renderer, pose: Float64Array, episode: EpisodeKey | None) -> Shot:
    """What a robot sees that stands at a pose x, y [m], yaw [rad], shape (3,)."""
    return Shot(step=0, pose_at=path_poses(pose[None], renderer.scene.maps.floor), episode=episode or "", still=True)
