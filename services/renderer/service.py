"""The renderer on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import topics
from readygo.services.renderer.handlers import handle_render
from readygo.services.renderer.renderer import Renderer


def attach(bus: Bus, renderer: Renderer, name: str) -> None:
    """Draw views for those who ask for the renderer called `name`."""
    bus.serve(topics.render(name), partial(handle_render, renderer))
