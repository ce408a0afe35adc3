"""The table `episode` of a ledger: rows in, rows out; `protocol` has the rules."""

from collections.abc import Iterable, Mapping
from typing import Any

from readygo.services.coordinator.database import Database
from readygo.services.coordinator.protocol import EpisodeRow, Holder, StageState

_COLUMNS = (
    "idx, stage, state, attempt, failures, deaths, worker, role, session, recorder, shard, samples, driven_by, reason"
)


class Episodes:
    """Episodes by index, and by what holds them."""

    def __init__(self, database: Database) -> None:
        """Read and write this table of a database."""
        self._database = database

    def get(self, index: int) -> EpisodeRow | None:
        """The episode of an index, None if it is not open."""
        found = self._where("idx = ?", index)
        return found[0] if found else None

    def first_waiting(self, stage: str) -> EpisodeRow | None:
        """The waiting episode of smallest index at a stage."""
        found = self._where("state = 'waiting' AND stage = ? ORDER BY idx LIMIT 1", stage)
        return found[0] if found else None

    def leased_episodes(self, *, before_s: float | None = None) -> list[EpisodeRow]:
        """All leases, or those whose time ends before `before_s`."""
        if before_s is None:
            return self._where("state = 'leased'")
        return self._where("state = 'leased' AND deadline_s < ?", before_s)

    def held_by(self, holder: Holder) -> list[EpisodeRow]:
        """What a worker holds."""
        return self._where(
            "state = 'leased' AND worker = ? AND role = ? AND session = ?", holder.worker, holder.role, holder.session
        )

    def of_recorder(self, recorder: str) -> list[EpisodeRow]:
        """What was leased, granted or committed to a recorder."""
        return self._where("state IN ('leased', 'granted', 'committed') AND recorder = ?", recorder)

    def in_shard(self, shard: str) -> list[EpisodeRow]:
        """The durable episodes of a shard."""
        return self._where("state = 'committed' AND shard = ?", shard)

    def store(self, episode: EpisodeRow) -> None:
        """Write an episode back."""
        holder = episode.holder
        self._database.run(
            """UPDATE episode SET stage = ?, state = ?, attempt = ?, failures = ?, deaths = ?, worker = ?, role = ?,
            session = ?, recorder = ?, shard = ?, samples = ?, driven_by = ?, reason = ? WHERE idx = ?""",
            episode.stage,
            episode.state.value,
            episode.attempt,
            episode.failures,
            episode.deaths,
            holder.worker,
            holder.role,
            holder.session,
            episode.recorder,
            episode.shard,
            episode.samples,
            episode.driven_by,
            episode.reason,
            episode.index,
        )

    def begin_lease(self, index: int, deadline_s: float, *, with_policy: bool) -> str:
        """Note until when a lease holds; returns the policy that comes with it, empty without one."""
        row = self._database.one(
            """UPDATE episode SET deadline_s = ?, policy = CASE WHEN ? THEN
                coalesce(assigned, (SELECT sha256 FROM policy ORDER BY version DESC LIMIT 1), '') ELSE '' END
            WHERE idx = ? RETURNING policy""",
            deadline_s,
            with_policy,
            index,
        )
        assert row is not None
        return str(row[0])

    def renew(self, index: int, attempt: int, deadline_s: float) -> bool:
        """Prolong a lease; False if the attempt does not hold it."""
        return self._database.has_row(
            "UPDATE episode SET deadline_s = ? WHERE idx = ? AND attempt = ? AND state = 'leased' RETURNING idx",
            deadline_s,
            index,
            attempt,
        )

    def open(self, indices: Iterable[int], stage: str, *, assigned: Mapping[int, str] | None = None) -> None:
        """Have episodes of these indices wait for a stage; those that are open stay as they are."""
        rows = [(index, stage, (assigned or {}).get(index)) for index in indices]
        with self._database.together():
            self._database.run_each(
                "INSERT OR IGNORE INTO episode (idx, stage, state, assigned) VALUES (?, ?, 'waiting', ?)", rows
            )

    def _where(self, condition: str, *values: object) -> list[EpisodeRow]:
        return [
            _episode(row) for row in self._database.all(f"SELECT {_COLUMNS} FROM episode WHERE {condition}", *values)
        ]


def _episode(row: tuple[Any, ...]) -> EpisodeRow:
    index, stage, state, attempt, failures, deaths, worker, role, session, recorder, shard, samples, driven, reason = (
        row
    )
    return EpisodeRow(
        index=index,
        stage=stage,
        state=StageState(state),
        attempt=attempt,
        failures=failures,
        deaths=deaths,
        holder=Holder(worker=worker, role=role, session=session),
        recorder=recorder,
        shard=shard,
        samples=samples,
        driven_by=driven,
        reason=reason,
    )
