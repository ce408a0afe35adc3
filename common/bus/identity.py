"""Who a participant of a bus is, as its certificate says."""

from dataclasses import dataclass
from pathlib import Path

COORDINATOR = "coordinator"
RECORDER = "recorder"
ALL = "all"
"""A worker that does every stage of the line, the later ones first."""
OPERATOR = "operator"
"""Pauses, resumes and cancels runs."""
MONITOR = "monitor"
"""Looks, and changes nothing."""
TRAINER = "trainer"
ANONYMOUS = "anonymous"
"""Name of every asker where no certificates are used: each process that knows the run's token may do everything."""


@dataclass(frozen=True, kw_only=True)
class Identity:
    """A certificate of a role, with what it is proved and checked by."""

    name: str
    """The certificate's common name: a role, or a role and a name such as "recorder.rec0"."""
    certificate: Path
    key: Path
    authority: Path
    """The certificate of the authority that signed all of a fleet's."""


@dataclass(frozen=True, slots=True)
class Member:
    """A worker that is on the bus."""

    role: str
    name: str
    """Differs between workers of one role."""
    session: str
    """Differs between the lives of one worker, see `Bus.announce`."""


def role_of(name: str) -> str:
    """The role of a common name."""
    return name.partition(".")[0]
