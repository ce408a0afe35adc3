"""The renderer on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import RenderRequest
from readygo.services.renderer.handlers import Renderer, handle_render


def attach(bus: Bus, renderer: Renderer, name: str) -> None:
    """Answer render requests on "render/{name}"."""
    bus.serve(f"render/{name}", RenderRequest, partial(handle_render, renderer))
