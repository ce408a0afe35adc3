"""How many episodes are where: what a ledger can be asked; nothing of it changes anything."""

from collections.abc import Sequence

from readygo.common.messages import Stage
from readygo.services.coordinator.database import Database
from readygo.services.coordinator.protocol import ASIDE


class Census:
    """Questions to the episodes of a ledger."""

    def __init__(self, database: Database, stages: Sequence[Stage]) -> None:
        """Ask a database.

        Args:
            database: The ledger's.
            stages: The line that the episodes pass.
        """
        self._database = database
        self._stages = tuple(stages)

    def aside(self) -> int:
        """Episodes that were set aside."""
        return self._database.count(
            "SELECT count(*) FROM episode WHERE state = 'rejected' AND reason LIKE ?", f"{ASIDE}%"
        )

    def set_aside(self) -> dict[int, str]:
        """Why each episode that was given up was, by index."""
        rows = self._database.all(
            "SELECT idx, reason FROM episode WHERE state = 'rejected' AND reason LIKE ? ORDER BY idx", f"{ASIDE}%"
        )
        return {index: reason.removeprefix(ASIDE) for index, reason in rows}

    def loads(self) -> dict[str, int]:
        """Episodes that are on their way to a recorder, by its name."""
        return dict(
            self._database.all(
                """SELECT recorder, count(*) FROM episode WHERE state IN ('leased', 'granted') AND stage = ?
                GROUP BY recorder""",
                self._stages[-1].name,
            )
        )

    def waiting(self) -> dict[str, int]:
        """Episodes that wait, by stage."""
        return dict(self._database.all("SELECT stage, count(*) FROM episode WHERE state = 'waiting' GROUP BY stage"))

    def waiting_at(self, stage: Stage) -> int:
        """Episodes that wait for a stage."""
        return self._database.count("SELECT count(*) FROM episode WHERE state = 'waiting' AND stage = ?", stage.name)

    def begun_count(self) -> int:
        """Episodes that wait or are held behind the first stage: those that were begun and are not done."""
        later = [stage.name for stage in self._stages[1:]]
        marks = ", ".join("?" * len(later))
        return self._database.count(
            f"SELECT count(*) FROM episode WHERE state IN ('waiting', 'leased') AND stage IN ({marks})", *later
        )

    def leases(self) -> list[tuple[str, str, str, int, int]]:
        """Role and name of the worker, stage, index and attempt of every lease."""
        return self._database.all(
            "SELECT role, worker, stage, idx, attempt FROM episode WHERE state = 'leased' ORDER BY idx"
        )

    def leased_by_stage(self) -> dict[str, int]:
        """Episodes that a worker holds, by stage."""
        return dict(self._database.all("SELECT stage, count(*) FROM episode WHERE state = 'leased' GROUP BY stage"))

    def rejections(self) -> dict[str, int]:
        """Rejected indices by reason."""
        return dict(
            self._database.all(
                "SELECT reason, count(*) FROM episode WHERE state = 'rejected' GROUP BY reason ORDER BY reason"
            )
        )

    def continued_by_reason(self) -> dict[str, int]:
        """Number of episodes that a stage rejected and that continue or are durable nevertheless, by reason."""
        return dict(
            self._database.all(
                """SELECT reason, count(*) FROM episode WHERE state != 'rejected' AND reason != ''
                GROUP BY reason ORDER BY reason"""
            )
        )

    def rejection_reasons(self) -> dict[int, str]:
        """Reason of every rejected index, by index."""
        return dict(self._database.all("SELECT idx, reason FROM episode WHERE state = 'rejected' ORDER BY idx"))

    def committed_counts(self) -> tuple[int, int]:
        """Durable episodes, and the samples in them."""
        row = self._database.one("SELECT episodes, samples FROM durable")
        assert row is not None
        return int(row[0]), int(row[1])

    def results(self) -> set[str]:
        """Hashes of all results that are still needed."""
        return {row[0] for row in self._database.all("SELECT sha256 FROM result")}

    def driven_by(self) -> dict[int, str]:
        """The offered policy that drove, empty for none, of every durable episode by its index."""
        return dict(self._database.all("SELECT idx, driven_by FROM episode WHERE state = 'committed' ORDER BY idx"))

    def granted_attempts(self, recorder: str) -> dict[int, int]:
        """Attempts that were granted to a recorder and are not yet reported durable, by index."""
        return dict(
            self._database.all(
                "SELECT idx, attempt FROM episode WHERE state = 'granted' AND recorder = ? ORDER BY idx", recorder
            )
        )

    def granted_recorders(self) -> set[str]:
        """Recorders that hold grants."""
        return {row[0] for row in self._database.all("SELECT DISTINCT recorder FROM episode WHERE state = 'granted'")}

    def recorder_of(self, index: int) -> str:
        """The recorder that an episode was last leased, granted or committed to; empty if it was to none."""
        row = self._database.one("SELECT recorder FROM episode WHERE idx = ?", index)
        return str(row[0]) if row else ""

    def shards(self) -> dict[str, dict[int, int]]:
        """Samples of every durable episode by its index, by the shard that it is in."""
        found: dict[str, dict[int, int]] = {}
        for shard, index, samples in self._database.all(
            "SELECT shard, idx, samples FROM episode WHERE state = 'committed'"
        ):
            found.setdefault(shard, {})[index] = samples
        return found
