"""The run's ledger: which episode is at which stage, who holds it, and under which attempt.

One SQLite file (write-ahead log). Episodes are the rows; a run of N episodes always has exactly N rows that are not
rejected, opened in the order of their indices, so the committed ones are the N smallest accepted indices and nothing is
ever made in vain.
"""

from collections.abc import Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from readygo.common.messages import Stage, VerdictStatus
from readygo.common.messages.stages import EXPERT_LINE
from readygo.services.coordinator.census import ASIDE, Census
from readygo.services.coordinator.database import Database
from readygo.services.coordinator.notes import Notes
from readygo.services.coordinator.policies import Policies


@dataclass(frozen=True, kw_only=True)
class Lease:
    """A claim on one stage of one episode."""

    index: int
    attempt: int
    inputs: tuple[str, ...]
    """Hashes of the results that the stage needs, in the order of `Stage.needs`."""
    policy: str = ""
    """The offered policy that comes with it, for a stage that records; empty without any."""


_FORGOTTEN = "rejected before the ledger was made anew"
_REBUILDING = "rebuilding"
_REBUILT = "rebuilt"
"""Key of the length that a run was to have when its ledger was made anew."""
_RETIRED = "retired/"
"""Begins the key of a recorder that was given up."""


class Ledger:
    """Transactions on the ledger file; safe to call from several threads."""

    def __init__(self, path: Path, stages: Sequence[Stage] = EXPERT_LINE) -> None:
        """Open the file, or make it.

        Args:
            path: The file.
            stages: The line that the episodes pass, see `RunSpec.stages`.

        Raises:
            RunError: If it is no ledger or cannot be written; so do all other methods.
        """
        self.path = path
        self._database = Database(path)
        self._stages = tuple(stages)
        self.census = Census(self._database, stages)
        """What may be asked of the episodes."""
        self.policies = Policies(self._database)
        """Those that were offered."""
        self.notes = Notes(self._database)
        """What is noted of the run as a whole."""

    def close(self) -> None:
        """Close the file."""
        self._database.close()

    def check(self) -> None:
        """Raise RunError if the file is damaged."""
        self._database.check()

    def together(self) -> AbstractContextManager[None]:
        """Do what the block does in one transaction, all of it or nothing: each costs more than what it writes."""
        return self._database.together()

    def open_episodes(self, wanted: int) -> int:
        """Open indices until `wanted` of them are not rejected; returns how many were opened."""
        with self._database.together():
            following = self._database.count("SELECT coalesce(max(idx) + 1, 0) FROM episode")
            total = self._database.count("SELECT count(*) FROM episode")
            rejected = self._database.count("SELECT count(*) FROM episode WHERE state = 'rejected'")
            missing = max(0, wanted - (total - rejected))
            self._database.run_each(
                "INSERT INTO episode (idx, stage, state) VALUES (?, ?, 'waiting')",
                [(following + k, self._stages[0].name) for k in range(missing)],
            )
        return missing

    def drop_episodes(self, wanted: int) -> None:
        """Forget the indices behind the `wanted` smallest ones that are not rejected: the run was to be longer.

        Nothing is forgotten where an index behind them is durable. In a ledger that was made anew many may be: what was
        rejected before them is not known yet.
        """
        with self._database.together():
            if wanted >= self._indices_to_last_durable():
                self._database.run(
                    """DELETE FROM episode WHERE idx > (SELECT idx FROM episode WHERE state != 'rejected'
                    ORDER BY idx LIMIT 1 OFFSET ?)""",
                    wanted - 1,
                )
                self._database.run("DELETE FROM result WHERE idx NOT IN (SELECT idx FROM episode)")

    def wanted_min(self) -> int:
        """Length of the shortest run that holds all durable episodes."""
        count = self._indices_to_last_durable()
        rebuilt = self.notes.get(_REBUILT)
        return min(count, int(rebuilt)) if rebuilt else count

    def _indices_to_last_durable(self) -> int:
        return self._database.count(
            """SELECT count(*) FROM episode WHERE state != 'rejected'
            AND idx <= (SELECT max(idx) FROM episode WHERE state IN ('granted', 'committed'))"""
        )

    def claim(self, stage: Stage, worker: str, deadline_s: float, recorder: str = "") -> Lease | None:
        """Lease the waiting episode of smallest index at `stage`, if there is one, to be given to a recorder.

        With the stage that records comes the policy that is assigned to the episode, else the newest one.
        """
        with self._database.lock:
            row = self._database.one(
                """UPDATE episode SET state = 'leased', attempt = attempt + 1, worker = ?, deadline_s = ?, recorder = ?,
                policy = CASE WHEN ? THEN
                    coalesce(assigned, (SELECT sha256 FROM policy ORDER BY version DESC LIMIT 1), '') ELSE '' END
                WHERE idx = (SELECT idx FROM episode WHERE state = 'waiting' AND stage = ? ORDER BY idx LIMIT 1)
                RETURNING idx, attempt, policy""",
                worker,
                deadline_s,
                recorder,
                stage.records,
                stage.name,
            )
            if row is None:
                return None
            results = dict(self._database.all("SELECT stage, sha256 FROM result WHERE idx = ?", row[0]))
        return Lease(index=row[0], attempt=row[1], inputs=tuple(results[name] for name in stage.needs), policy=row[2])

    def renew(self, index: int, attempt: int, deadline_s: float) -> bool:
        """Prolong a lease; False if the attempt does not hold it any more."""
        return self._database.held(
            "UPDATE episode SET deadline_s = ? WHERE idx = ? AND attempt = ? AND state = 'leased' RETURNING idx",
            deadline_s,
            index,
            attempt,
        )

    def advance(self, stage: Stage, index: int, attempt: int, sha256: str, *, reason: str = "") -> bool:
        """Store a stage's result and pass the episode on; False if the attempt does not hold the lease.

        A `reason` says that the stage rejected the episode, which is kept nevertheless.
        """
        following = self._stages[self._stages.index(stage) + 1]
        with self._database.together():
            held = self._database.held(
                """UPDATE episode SET stage = ?, state = 'waiting', worker = '',
                reason = CASE WHEN ? = '' THEN reason ELSE ? END
                WHERE idx = ? AND attempt = ? AND state = 'leased' AND stage = ? RETURNING idx""",
                following.name,
                reason,
                reason,
                index,
                attempt,
                stage.name,
            )
            if held:
                self._database.run("INSERT OR REPLACE INTO result VALUES (?, ?, ?)", index, stage.name, sha256)
        return held

    def reject(self, stage: Stage, index: int, attempt: int, reason: str) -> bool:
        """Skip an index for good; False if the attempt does not hold the lease."""
        return self._database.held(
            """UPDATE episode SET state = 'rejected', reason = ?, worker = ''
            WHERE idx = ? AND attempt = ? AND state = 'leased' AND stage = ? RETURNING idx""",
            reason,
            index,
            attempt,
            stage.name,
        )

    def fail(self, stage: Stage, index: int, attempt: int) -> int | None:
        """Begin an episode anew after a worker's error; returns its failures so far, None if not held.

        From the first stage: what earlier ones have made may be what the worker cannot read.
        """
        row = self._database.one(
            """UPDATE episode SET state = 'waiting', failures = failures + 1, worker = '', stage = ?
            WHERE idx = ? AND attempt = ? AND state = 'leased' AND stage = ? RETURNING failures""",
            self._stages[0].name,
            index,
            attempt,
            stage.name,
        )
        return None if row is None else int(row[0])

    def begin_anew(self, index: int) -> None:
        """Have an episode pass all stages again that waits or that a worker holds."""
        self._database.run(
            "UPDATE episode SET state = 'waiting', worker = '', stage = ? "
            "WHERE idx = ? AND state IN ('waiting', 'leased')",
            self._stages[0].name,
            index,
        )

    def set_aside(self, index: int, reason: str) -> dict[str, str]:
        """Give an episode up that waits; the next index takes its place.

        Returns:
            Hashes of the results that it came to, by stage.
        """
        with self._database.together():
            results = dict(self._database.all("SELECT stage, sha256 FROM result WHERE idx = ?", index))
            self._database.run(
                "UPDATE episode SET state = 'rejected', reason = ? WHERE idx = ? AND state = 'waiting'",
                ASIDE + reason,
                index,
            )
            self._database.run("DELETE FROM result WHERE idx = ?", index)
        return results

    def take_from(self, recorder: str) -> int:
        """Have others record what is on its way to a recorder and not durable; returns how many episodes that are."""
        rows = self._database.all(
            """UPDATE episode SET state = 'waiting', worker = ''
            WHERE state IN ('leased', 'granted') AND recorder = ? AND stage = ? RETURNING idx""",
            recorder,
            self._stages[-1].name,
        )
        return len(rows)

    def retire(self, recorder: str) -> int:
        """Give a recorder up with all that it has: its episodes are made again; returns how many those are."""
        with self._database.together():
            rows = self._database.all(
                """UPDATE episode SET state = 'waiting', worker = '', stage = ?
                WHERE state IN ('leased', 'granted', 'committed') AND recorder = ? RETURNING idx""",
                self._stages[0].name,
                recorder,
            )
            self.notes.put(_RETIRED + recorder)
        return len(rows)

    def retired(self) -> set[str]:
        """The recorders that were given up."""
        return self.notes.keys(_RETIRED)

    def grant(self, index: int, attempt: int, recorder: str) -> VerdictStatus:
        """Let a recorder make an episode durable: OK, STALE or DONE."""
        row = self._database.one(
            """UPDATE episode SET state = 'granted', recorder = ? WHERE idx = ? AND attempt = ? AND stage = ?
            AND (state = 'leased' OR (state = 'granted' AND recorder = ?)) RETURNING idx""",
            recorder,
            index,
            attempt,
            self._stages[-1].name,
            recorder,
        )
        if row is not None:
            return VerdictStatus.OK
        durable = self._database.held("SELECT idx FROM episode WHERE idx = ? AND state = 'committed'", index)
        return VerdictStatus.DONE if durable else VerdictStatus.STALE

    def commit(self, index: int, recorder: str, shard: str, samples: int, policy: str = "") -> list[str] | None:
        """Note that an episode is durable.

        Args:
            index: Of the episode.
            recorder: Who has it.
            shard: In which file.
            samples: How many it has.
            policy: The offered policy that drove.

        Returns:
            Hashes of results that nobody needs any more; None if another recorder has made the episode durable.
        """
        with self._database.together():
            held = self._database.held(
                """UPDATE episode SET state = 'committed', stage = ?, recorder = ?, shard = ?, samples = ?,
                driven_by = ?, worker = ''
                WHERE idx = ? AND NOT (state = 'committed' AND recorder != ?) RETURNING idx""",
                self._stages[-1].name,
                recorder,
                shard,
                samples,
                policy,
                index,
                recorder,
            )
            if not held:
                return None
            # Episodes whose results are equal share the blob.
            unshared = """SELECT DISTINCT sha256 FROM result WHERE idx = ?
                AND sha256 NOT IN (SELECT sha256 FROM result WHERE idx != ?)"""
            hashes = [row[0] for row in self._database.all(unshared, index, index)]
            self._database.run("DELETE FROM result WHERE idx = ?", index)
        return hashes

    def take_back(self, index: int, recorder: str) -> bool:
        """Undo a grant whose episode did not become durable; False if the recorder does not hold one.

        What is left of its results are those of an attempt that was recorded: without them it is begun anew.
        """
        return self._database.held(
            """UPDATE episode SET state = 'waiting', worker = '',
            stage = CASE WHEN EXISTS (SELECT 1 FROM result WHERE result.idx = episode.idx) THEN stage ELSE ? END
            WHERE idx = ? AND state = 'granted' AND recorder = ? RETURNING idx""",
            self._stages[0].name,
            index,
            recorder,
        )

    def adopt(self, index: int, recorder: str, shard: str, samples: int, policy: str) -> None:
        """Note an episode as durable that a shard holds, whatever is known of it."""
        self._database.run("INSERT OR IGNORE INTO episode (idx, stage, state) VALUES (?, '', 'waiting')", index)
        self.commit(index, recorder, shard, samples, policy)

    def begin_rebuild(self) -> None:
        """Note that the ledger is being made anew, until `fill_gaps`: a kill in between leaves it `unfinished`."""
        self.notes.put(_REBUILDING)

    @property
    def unfinished(self) -> bool:
        """True if it knows of no episode, or not of all that its shards hold: it was being made anew."""
        return not self._database.held("SELECT 1 FROM episode LIMIT 1") or _REBUILDING in self.notes

    def fill_gaps(self, last: int, wanted: int) -> None:
        """Open the indices up to `last` that nothing is known of, and so end making a ledger anew.

        Some of them were rejected, and will be again: the run is not longer than `wanted` for that.
        """
        with self._database.together():
            self._database.run_each(
                "INSERT OR IGNORE INTO episode (idx, stage, state) VALUES (?, ?, 'waiting')",
                [(index, self._stages[0].name) for index in range(last + 1)],
            )
            if self.census.committed()[0] >= wanted:
                # A run has no more open indices than episodes: all others were rejected.
                self._database.run(
                    "UPDATE episode SET state = 'rejected', reason = ? WHERE state = 'waiting'", _FORGOTTEN
                )
            self.notes.put(_REBUILT, str(wanted))
            self.notes.drop(_REBUILDING)

    def doubt(self, shard: str) -> None:
        """Have the recorder of a shard say again which of its episodes are durable."""
        self._database.run("UPDATE episode SET state = 'granted' WHERE state = 'committed' AND shard = ?", shard)

    def miss(self, indices: Sequence[int]) -> None:
        """Begin episodes anew that were durable and are no more."""
        with self._database.together():
            self._database.run_each(
                "UPDATE episode SET state = 'waiting', worker = '', stage = ? WHERE idx = ? AND state = 'committed'",
                [(self._stages[0].name, index) for index in indices],
            )

    def requeue_expired(self, now_s: float) -> int:
        """End the leases whose time is over; returns how many."""
        return self._requeue("deadline_s < ?", now_s)

    def requeue_worker(self, worker: str) -> list[tuple[int, int]]:
        """End the leases of a worker that is gone; returns their indices, and how many workers each has outlived."""
        return self._database.all(
            """UPDATE episode SET state = 'waiting', worker = '', deaths = deaths + 1
            WHERE state = 'leased' AND worker = ? RETURNING idx, deaths""",
            worker,
        )

    def requeue_all(self) -> None:
        """End every lease: a new fleet starts on an old ledger."""
        self._requeue("true")

    def assign(self, policies: Mapping[int, str]) -> None:
        """Open exactly these indices, each for the policy that shall drive it; empty is for none of the offered ones.

        Indices that are open already stay as they are.
        """
        with self._database.together():
            self._database.run_each(
                "INSERT OR IGNORE INTO episode (idx, stage, state, assigned) VALUES (?, ?, 'waiting', ?)",
                [(index, self._stages[0].name, sha256) for index, sha256 in policies.items()],
            )

    def _requeue(self, condition: str, *values: object) -> int:
        statement = (
            f"UPDATE episode SET state = 'waiting', worker = '' WHERE state = 'leased' AND {condition} RETURNING 1"
        )
        return len(self._database.all(statement, *values))
