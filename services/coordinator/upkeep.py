"""Periodic checks of the coordinator: leases that end, and stages that wait without a worker."""

from readygo.common.errors import DiskError
from readygo.services.coordinator.coordinator import LEDGER, Coordinator
from readygo.services.coordinator.giving_up import set_aside
from readygo.services.coordinator.protocol import Holder

ABSENT_S = 60.0
"""Status reports a stage that has had no worker for this time [s]."""
DEATHS_MAX = 8
"""Workers that may end while they hold one and the same episode before it is set aside."""


def note_absent(coordinator: Coordinator) -> None:
    """Report stages that episodes wait for and that no present process does; call it regularly."""
    for stage in coordinator.spec.stages:
        waiting = coordinator.ledger.census.waiting_at(stage)
        absent_s = coordinator.roster.absent_s(stage.name, stage.role, needed=waiting > 0)
        words = (
            f"{waiting} episodes wait for stage {stage.name}, and no {stage.role} is there; "
            f"`readygo worker {stage.role}` starts one."
        )
        coordinator.note_trouble(f"absence of {stage.name}", words if absent_s > ABSENT_S else "")


def requeue_lost(coordinator: Coordinator, *, holder: Holder | None = None) -> bool:
    """End the leases that ran out, or those of a worker's life that ended; True if there were any.

    A disk that takes nothing is no reason to end: it is told as trouble, and the leases are freed when it does again.
    """
    try:
        ended = _requeue_expired(coordinator) if holder is None else _requeue_holder(coordinator, holder)
        # Nothing but a write tells that the disk takes writes again.
        if ended or LEDGER in coordinator.troubles:
            coordinator.ledger.notes.add("requeued", ended)
    except DiskError as error:
        coordinator.note_trouble(LEDGER, str(error))
        return False
    coordinator.note_trouble(LEDGER, "")
    return ended > 0


def _requeue_expired(coordinator: Coordinator) -> int:
    return coordinator.ledger.requeue_expired(coordinator.clock())


def _requeue_holder(coordinator: Coordinator, holder: Holder) -> int:
    ended = coordinator.ledger.requeue_holder(holder)
    for index, deaths in ended:
        if deaths >= DEATHS_MAX:
            set_aside(coordinator, index, f"{deaths} workers ended while they held it")
    return len(ended)
