"""The animator on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import AnimateRequest
from readygo.services.animator.handlers import Animator, handle_animate

TOPIC = "animate"


def attach(bus: Bus, animator: Animator) -> None:
    """Answer `animate` requests."""
    bus.serve(TOPIC, AnimateRequest, partial(handle_animate, animator))
