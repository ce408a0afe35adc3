"""Proof that a lease is held: names are no secret, and what a claim's reply alone carried is."""

import hmac
import logging
import secrets

from readygo.common.messages import Verdict, VerdictStatus

log = logging.getLogger(__name__)


class LeaseProofs:
    """What the holders of leases are told, and they alone."""

    def __init__(self) -> None:
        """Leases that were proved by others before are proved no more."""
        self._secret = secrets.token_bytes(32)

    def of(self, index: int, attempt: int) -> str:
        """What the holder of a lease is told."""
        return hmac.digest(self._secret, f"{index} {attempt}".encode(), "sha256").hex()

    def proves(self, proof: str, index: int, attempt: int) -> bool:
        """True if somebody who says this holds the lease."""
        return hmac.compare_digest(proof.encode(), self.of(index, attempt).encode())


def not_the_holder(index: int, attempt: int) -> Verdict:
    """What is said to somebody who does not prove a lease."""
    log.warning("attempt %d of episode %d: refused to somebody who does not hold its lease", attempt, index)
    reason = f"attempt {attempt} of episode {index} is held by another worker"
    return Verdict(status=VerdictStatus.STALE, reason=reason)
