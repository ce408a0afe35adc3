"""The recorder on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import topics
from readygo.services.recorder.handlers import Recorder, handle_append


def attach(bus: Bus, recorder: Recorder) -> None:
    """Serve a recorder; what its last process left is cleared up first if the coordinator answers already."""
    recorder.settle()
    # Each sender must prove a lease of the episode, hence no roles here: the router knows them.
    bus.serve(topics.append(recorder.name), partial(handle_append, recorder))
