"""The embedded scene, made by code: a furnished flat with a garden in front of its windows."""

from readygo.common.scenes.embedded.bundle import ensure_embedded_scene, scene_name
from readygo.common.scenes.embedded.scene import embedded_scene_cloud, embedded_sky

__all__ = ["embedded_scene_cloud", "embedded_sky", "ensure_embedded_scene", "scene_name"]
