"""An evaluation's keeper on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.messages import topics
from readygo.services.evaluator.keeper import Keeper, handle_drives, handle_keep


def attach(bus: Bus, keeper: Keeper) -> None:
    """Serve an evaluation."""
    bus.serve(topics.EVALUATION_PLAN, lambda _: keeper.plan)
    bus.serve(topics.EVALUATION_DRIVES, partial(handle_drives, keeper))
    bus.serve(topics.EVALUATION_KEEP, partial(handle_keep, keeper))
