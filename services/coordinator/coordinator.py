"""A run as its coordinator has it; the ledger holds all of it that must survive."""

import logging
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence

from readygo.common.errors import RunError
from readygo.common.messages import (
    DoneRequest,
    PolicyFile,
    RunSpec,
)
from readygo.services.coordinator.blobs import BlobStore
from readygo.services.coordinator.config import CoordinatorConfig
from readygo.services.coordinator.ledger import Ledger
from readygo.services.coordinator.proofs import LeaseProofs
from readygo.services.coordinator.roster import Roster

log = logging.getLogger(__name__)

REASON_MAX = 2000
"""Characters of a reason that are kept."""
LEDGER = "ledger"
"""Key of `Coordinator.troubles` for the coordinator's own disk when it takes nothing."""


class Coordinator:
    """One run: what is wanted, what is done, and who may do the rest."""

    def __init__(
        self,
        *,
        spec: RunSpec,
        wanted: int,
        ledger: Ledger,
        blobs: BlobStore,
        config: CoordinatorConfig | None = None,
        check_policy: Callable[[Sequence[PolicyFile]], None] = lambda files: None,
        holds: Callable[[DoneRequest], bool] = lambda report: True,
        set_aside: Callable[[int, str, Mapping[str, bytes]], str] = lambda index, reason, results: "",
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        """Resume a run from its ledger; no worker holds a lease at that time.

        Args:
            spec: What the run is.
            wanted: Episodes that it shall have.
            ledger: How far it is.
            blobs: Results between the stages, and offered policies.
            config: Settings.
            check_policy: Raises ReadygoError at the files of a policy that cannot drive in the run.
            holds: Tells whether an episode is where its recorder says that it is.
            set_aside: Gets what was given up: index, reason and results by stage; answers with words on where it is.
            clock: Time that leases are measured by [s].

        Raises:
            RunError: If a recorder that holds grants is not among the run's recorders any more.
        """
        self.spec = spec
        self.wanted = wanted
        self.ledger = ledger
        self.blobs = blobs
        self.config = config or CoordinatorConfig()
        self.check_policy = check_policy
        self.holds = holds
        self.set_aside = set_aside
        self.clock = clock
        self.roster = Roster(clock)
        self.numeric_class = spec.metadata.get("numeric_class", "")
        """What all of the run is made with; agreed on with the first claim."""
        self.told: object = None
        """What of note was said last of how far the run is."""
        self.told_s = 0.0
        self.proofs = LeaseProofs()
        """What leases are proved by; they end with the process."""
        self.failed = ""
        self.paused = ledger.notes.get("paused") == "yes"
        self.cancelled = False
        self.troubles: dict[str, str] = {}
        """Problems that a user must fix before the run continues, by the component that they block."""
        self.recorders = tuple(name for name in self.config.recorders if name not in ledger.retired_recorders())
        """Names of the recorders that were not given up."""
        self.given: Counter[str] = Counter()
        """Leases that each recorder got since the process began."""
        self._check_recorders()
        if self.numeric_class:
            self.numeric_class = ledger.notes.agree("numeric_class", self.numeric_class)
        ledger.requeue_all()
        ledger.drop_episodes(wanted)
        blobs.keep_only(
            ledger.census.results() | {file.sha256 for policy in ledger.policies.all() for file in policy.files}
        )
        ledger.open_episodes(wanted)

    @property
    def finished(self) -> bool:
        """True when all wanted episodes are durable."""
        return self.ledger.census.committed_counts()[0] >= self.wanted

    @property
    def over(self) -> bool:
        """True when no more work will be given out."""
        return bool(self.failed) or self.cancelled or self.finished

    def choose_recorder(self) -> str:
        """The recorder for the next episode: of those that can record, the one with the fewest on their way to it.

        Of equal ones it is the one that got the fewest so far.
        """
        loads = self.ledger.census.loads()
        return min(self._able() or self.recorders, key=lambda name: (loads.get(name, 0), self.given[name]))

    def _able(self) -> list[str]:
        """Recorders that nothing is known of that would keep them from recording."""
        return [name for name in self.recorders if not {name, _presence(name)} & set(self.troubles)]

    def others_take_over(self, recorder: str) -> bool:
        """Have other recorders record what one cannot; False if there is none that can."""
        if set(self._able()) <= {recorder}:
            return False
        if taken := self.ledger.take_from(recorder):
            log.warning("%d episodes that %s cannot record go to others", taken, recorder)
        return True

    def note_recorder(self, name: str, *, alive: bool) -> None:
        """A recorder came, or is gone: what was granted to it waits for it, and so do its senders."""
        # Another process may come under this name: each says itself what keeps it from recording.
        self.note_trouble(name, "")
        granted = 0 if alive else len(self.ledger.census.granted_attempts(name))
        gone = (
            f"Recorder {name} is gone and holds {granted} episodes; `readygo worker recorder --name {name}` starts it."
        )
        self.note_trouble(_presence(name), "" if alive else gone)

    def note_trouble(self, who: str, reason: str) -> None:
        """Note what keeps a component from its work; an empty reason removes the note."""
        if reason:
            self.troubles[who] = reason
        else:
            self.troubles.pop(who, None)

    def _check_recorders(self) -> None:
        """Refuse to leave out a recorder that may hold episodes which the ledger has not heard of."""
        if not self.recorders:
            raise RunError(
                f"All recorders of this run were given up ({', '.join(self.config.recorders)}): name another one in "
                "[coordinator] recorders."
            )
        if missing := sorted(self.ledger.census.granted_recorders() - set(self.config.recorders)):
            raise RunError(
                f"Recorder {missing[0]!r} was given episodes of this run; name it in [coordinator] recorders again."
            )


def _presence(recorder: str) -> str:
    """Key of `Coordinator.troubles` for a recorder that is gone."""
    return f"presence of {recorder}"
