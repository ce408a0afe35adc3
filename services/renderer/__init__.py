"""The renderer: images of a scene with people in it."""

from readygo.services.renderer.config import RendererConfig
from readygo.services.renderer.handlers import (
    NO_PICTURE,
    Renderer,
    described_samples,
    episode_header,
    episode_samples,
    handle_render,
)
from readygo.services.renderer.live import LiveCamera
from readygo.services.renderer.looks import Look, look_around, unclear
from readygo.services.renderer.service import attach

__all__ = [
    "NO_PICTURE",
    "LiveCamera",
    "Look",
    "Renderer",
    "RendererConfig",
    "attach",
    "described_samples",
    "episode_header",
    "episode_samples",
    "handle_render",
    "look_around",
    "unclear",
]
