"""An evaluation's keeper on the bus."""

from functools import partial

from readygo.common.bus import Bus
from readygo.common.bus.identity import ALL
from readygo.common.messages import topics
from readygo.common.messages.stages import EVALUATE
from readygo.services.evaluator.keeper import Keeper, handle_drives, handle_keep


def attach(bus: Bus, keeper: Keeper) -> None:
    """Serve an evaluation."""
    by = (EVALUATE.role, ALL)
    bus.serve(topics.EVALUATION_PLAN, lambda _: keeper.plan, by=by)
    bus.serve(topics.EVALUATION_DRIVES, partial(handle_drives, keeper), by=by)
    bus.serve(topics.EVALUATION_KEEP, partial(handle_keep, keeper), by=by)
