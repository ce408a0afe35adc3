"""Episodes that do not come about, and runs in which most do not."""

import logging

from readygo.services.coordinator.coordinator import Coordinator

log = logging.getLogger(__name__)

ASIDE_MAX = 3
"""The run fails after this many episodes were set aside if fewer are recorded."""
REJECTIONS_MAX = 200
"""The run fails after this many rejections if fewer than one index in 20 was accepted."""


def set_aside(coordinator: Coordinator, index: int, reason: str) -> None:
    """Give an episode up that fails again and again; a run in which most do ends with the reason."""
    results = coordinator.ledger.set_aside(index, reason)
    data = {stage: coordinator.blobs.get(sha256) or b"" for stage, sha256 in results.items()}
    where = coordinator.set_aside(index, reason, data)
    log.warning("episode %d is set aside: %s%s", index, reason, where)
    aside, committed = coordinator.ledger.census.aside(), coordinator.ledger.census.committed_counts()[0]
    if aside >= ASIDE_MAX and aside > committed:
        coordinator.failed = f"{aside} episodes were set aside, the last one is {index}: {reason}{where}"
        return
    coordinator.ledger.open_episodes(coordinator.wanted)


def after_rejection(coordinator: Coordinator) -> None:
    """Open the index that takes the place of a rejected one; a run that rejects nearly all ends with the reasons."""
    rejected = sum(coordinator.ledger.census.rejections().values())
    accepted = coordinator.ledger.census.committed_counts()[0] + coordinator.ledger.census.waiting_at(
        coordinator.spec.stages[-1]
    )
    if rejected >= REJECTIONS_MAX and rejected > 20 * accepted:
        reasons = ", ".join(f"{reason} ({count})" for reason, count in coordinator.ledger.census.rejections().items())
        coordinator.failed = f"{rejected} indices were rejected and {accepted} accepted: {reasons}."
        return
    coordinator.ledger.open_episodes(coordinator.wanted)
