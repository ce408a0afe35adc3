"""The animator on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import topics
from readygo.services.animator.handlers import Animator, handle_animate


def attach(bus: Bus, animator: Animator) -> None:
    """Animate the scenarios that are sent."""
    bus.serve(topics.ANIMATE, partial(handle_animate, animator))
