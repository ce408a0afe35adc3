"""Proof that a process holds a lease: a secret that only the reply to its claim carries."""

import hmac
import logging
import secrets

from readygo.common.messages import Verdict, VerdictStatus

log = logging.getLogger(__name__)


class LeaseProofs:
    """Makes and checks the secrets that only the holders of leases receive."""

    def __init__(self) -> None:
        """Draw a new secret; proofs from an earlier process are not valid any more."""
        self._secret = secrets.token_bytes(32)

    def of(self, index: int, attempt: int) -> str:
        """Proof that the holder of a lease receives."""
        return hmac.digest(self._secret, f"{index} {attempt}".encode(), "sha256").hex()

    def proves(self, proof: str, index: int, attempt: int) -> bool:
        """True if `proof` is the proof of this attempt's lease."""
        return hmac.compare_digest(proof.encode(), self.of(index, attempt).encode())


def not_the_holder(index: int, attempt: int) -> Verdict:
    """Verdict for a process that does not prove a lease."""
    log.warning("attempt %d of episode %d: refused, the sender does not hold its lease", attempt, index)
    reason = f"attempt {attempt} of episode {index} is held by another worker"
    return Verdict(status=VerdictStatus.STALE, reason=reason)
