"""The renderer: images of a scene with people in it."""

from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.handlers import Renderer, episode_header, episode_samples, handle_render
from readygo.services.renderer.service import attach

__all__ = ["Renderer", "RendererConfig", "attach", "episode_header", "episode_samples", "handle_render"]
