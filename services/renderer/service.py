"""The renderer on the bus."""

from functools import partial

from common.bus import Bus
from common.messages import RenderRequest
from services.renderer.handlers import Renderer, handle_render


def attach(bus: Bus, renderer: Renderer, name: str) -> None:
    """Answer render requests on "render/{name}"."""
    bus.serve(f"render/{name}", RenderRequest, partial(handle_render, renderer))
