"""The renderer: images of a scene with humans in it."""

from typing import TYPE_CHECKING

from readygo.common.lazy import lazy_names

if TYPE_CHECKING:
    from readygo.services.renderer.camera import Shot as Shot
    from readygo.services.renderer.camera import calibrations as calibrations
    from readygo.services.renderer.camera import path_poses as path_poses
    from readygo.services.renderer.config import SENSOR_RECIPES as SENSOR_RECIPES
    from readygo.services.renderer.config import RendererConfig as RendererConfig
    from readygo.services.renderer.config import SensorName as SensorName
    from readygo.services.renderer.live import LiveCamera as LiveCamera
    from readygo.services.renderer.looks import Look as Look
    from readygo.services.renderer.looks import goal_picture as goal_picture
    from readygo.services.renderer.looks import look_around as look_around
    from readygo.services.renderer.looks import unclear as unclear
    from readygo.services.renderer.renderer import Renderer as Renderer
    from readygo.services.renderer.renderer import pack_folder as pack_folder
    from readygo.services.renderer.renderer import static_clouds as static_clouds
    from readygo.services.renderer.renderer import view_image as view_image
    from readygo.services.renderer.samples import NO_PICTURE as NO_PICTURE
    from readygo.services.renderer.samples import described_samples as described_samples
    from readygo.services.renderer.samples import episode_header as episode_header
    from readygo.services.renderer.samples import episode_samples as episode_samples
    from readygo.services.renderer.samples import episode_shots as episode_shots
    from readygo.services.renderer.samples import with_goal_image as with_goal_image
    from readygo.services.renderer.service import attach as attach
else:
    _NAMES = {
        ".camera": (
            "Shot",
            "calibrations",
            "path_poses",
        ),
        ".config": (
            "RendererConfig",
            "SENSOR_RECIPES",
            "SensorName",
        ),
        ".live": ("LiveCamera",),
        ".looks": (
            "Look",
            "goal_picture",
            "look_around",
            "unclear",
        ),
        ".renderer": (
            "Renderer",
            "pack_folder",
            "static_clouds",
            "view_image",
        ),
        ".samples": (
            "NO_PICTURE",
            "described_samples",
            "episode_header",
            "episode_samples",
            "episode_shots",
            "with_goal_image",
        ),
        ".service": ("attach",),
    }
    __all__ = [name for names in _NAMES.values() for name in names]
    __getattr__ = lazy_names(__name__, _NAMES)
