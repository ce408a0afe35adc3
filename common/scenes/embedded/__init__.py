"""The embedded scene, made by code: a furnished flat with a garden in front of its windows."""

from readygo.common.scenes.embedded.bundle import ensure_embedded_scene, scene_name

__all__ = ["ensure_embedded_scene", "scene_name"]
