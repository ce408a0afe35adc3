"""The run's ledger: which episode is at which stage, who holds it, and under which attempt.

One SQLite file (write-ahead log). Episodes are the rows; a run of N episodes always has exactly N rows that are not
rejected, opened in the order of their indices, so the committed ones are the N smallest accepted indices and nothing is
ever made in vain.
"""

import json
import sqlite3
import threading
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from readygo.common.errors import DiskError, RunError
from readygo.common.messages import FileRef, PolicyRef, Stage, VerdictStatus
from readygo.common.messages.stages import EXPERT_LINE
from readygo.services.coordinator.schema import open_database


@dataclass(frozen=True, kw_only=True)
class Lease:
    """A claim on one stage of one episode."""

    index: int
    attempt: int
    inputs: tuple[str, ...]
    """Hashes of the results that the stage needs, in the order of `Stage.needs`."""
    policy: str = ""
    """The offered policy that comes with it, for a stage that records; empty without any."""


@dataclass(frozen=True, kw_only=True)
class OfferedPolicy:
    """A policy that was offered to the run."""

    version: int
    """From 1, in the order of the offers."""
    sha256: str
    """See `PolicyRef.sha256`."""
    files: tuple[FileRef, ...]
    samples: int
    """Durable samples when it was offered."""
    wall_ns: int
    """When it was offered, by the wall clock [ns]."""


ASIDE = "set aside: "
"""Begins the reason of an episode that was given up, unlike those that a stage rejected."""
_FORGOTTEN = "rejected before the ledger was made anew"
_REBUILDING = "rebuilding"
_REBUILT = "rebuilt"
"""Key of the length that a run was to have when its ledger was made anew."""
_TURN = "turn"
_RETIRED = "retired/"
"""Begins the key of a recorder that was given up."""
_DISK_CODES = (
    sqlite3.SQLITE_FULL,
    sqlite3.SQLITE_READONLY,
    sqlite3.SQLITE_IOERR,
    sqlite3.SQLITE_CANTOPEN,
    sqlite3.SQLITE_BUSY,
)


def _files_of(policies: Sequence[OfferedPolicy]) -> set[str]:
    return {file.sha256 for policy in policies for file in policy.files}


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
        self._stages = tuple(stages)
        self._lock = threading.RLock()
        try:
            self._db = open_database(path)
        except sqlite3.Error as error:
            raise self._worded(error) from error

    def close(self) -> None:
        """Close the file."""
        self._db.close()

    def agree(self, key: str, value: str) -> str:
        """The run's value for `key`, which is the first one that was proposed."""
        with self.together():
            self._db.execute("INSERT OR IGNORE INTO run VALUES (?, ?)", (key, value))
            (agreed,) = self._db.execute("SELECT value FROM run WHERE key = ?", (key,)).fetchone()
        return str(agreed)

    def note(self, key: str, value: str | None = None) -> str:
        """What is noted of the run under a key, empty if nothing is; a value replaces it."""
        if value is not None:
            self._run("INSERT OR REPLACE INTO run VALUES (?, ?)", key, value)
        row = self._one("SELECT value FROM run WHERE key = ?", key)
        return str(row[0]) if row else ""

    def next_turn(self, least: int) -> int:
        """The number of those who have led the run one after the other, higher than all before and at least `least`."""
        with self.together():
            turn = max(least, int(self.note(_TURN) or 0) + 1)
            self.note(_TURN, str(turn))
        return turn

    def open_episodes(self, wanted: int) -> int:
        """Open indices until `wanted` of them are not rejected; returns how many were opened."""
        with self.together():
            total, following = self._db.execute("SELECT count(*), coalesce(max(idx) + 1, 0) FROM episode").fetchone()
            (rejected,) = self._db.execute("SELECT count(*) FROM episode WHERE state = 'rejected'").fetchone()
            missing: int = max(0, wanted - (total - rejected))
            self._db.executemany(
                "INSERT INTO episode (idx, stage, state) VALUES (?, ?, 'waiting')",
                [(following + k, self._stages[0].name) for k in range(missing)],
            )
        return missing

    def drop_episodes(self, wanted: int) -> None:
        """Forget the indices behind the `wanted` smallest ones that are not rejected: the run was to be longer.

        Nothing is forgotten where an index behind them is durable. In a ledger that was made anew many may be: what was
        rejected before them is not known yet.
        """
        with self.together():
            if wanted >= self._indices_to_last_durable():
                self._db.execute(
                    """DELETE FROM episode WHERE idx > (SELECT idx FROM episode WHERE state != 'rejected'
                    ORDER BY idx LIMIT 1 OFFSET ?)""",
                    (wanted - 1,),
                )
                self._db.execute("DELETE FROM result WHERE idx NOT IN (SELECT idx FROM episode)")

    def wanted_min(self) -> int:
        """Length of the shortest run that holds all durable episodes."""
        count = self._indices_to_last_durable()
        rebuilt = self._one("SELECT value FROM run WHERE key = ?", _REBUILT)
        return min(count, int(rebuilt[0])) if rebuilt else count

    def _indices_to_last_durable(self) -> int:
        row = self._one(
            """SELECT count(*) FROM episode WHERE state != 'rejected'
            AND idx <= (SELECT max(idx) FROM episode WHERE state IN ('granted', 'committed'))"""
        )
        assert row is not None
        return int(row[0])

    def claim(self, stage: Stage, worker: str, deadline_s: float, recorder: str = "") -> Lease | None:
        """Lease the waiting episode of smallest index at `stage`, if there is one, to be given to a recorder.

        With the stage that records comes the policy that is assigned to the episode, else the newest one.
        """
        with self._lock:
            row = self._one(
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
            results = dict(self._all("SELECT stage, sha256 FROM result WHERE idx = ?", row[0]))
        return Lease(index=row[0], attempt=row[1], inputs=tuple(results[name] for name in stage.needs), policy=row[2])

    def renew(self, index: int, attempt: int, deadline_s: float) -> bool:
        """Prolong a lease; False if the attempt does not hold it any more."""
        return self._held(
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
        with self.together():
            held = self._held(
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
                self._db.execute("INSERT OR REPLACE INTO result VALUES (?, ?, ?)", (index, stage.name, sha256))
        return held

    def reject(self, stage: Stage, index: int, attempt: int, reason: str) -> bool:
        """Skip an index for good; False if the attempt does not hold the lease."""
        return self._held(
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
        row = self._one(
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
        self._run(
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
        with self.together():
            results = dict(self._all("SELECT stage, sha256 FROM result WHERE idx = ?", index))
            self._run(
                "UPDATE episode SET state = 'rejected', reason = ? WHERE idx = ? AND state = 'waiting'",
                ASIDE + reason,
                index,
            )
            self._run("DELETE FROM result WHERE idx = ?", index)
        return results

    def aside(self) -> int:
        """Episodes that were set aside."""
        row = self._one("SELECT count(*) FROM episode WHERE state = 'rejected' AND reason LIKE ?", f"{ASIDE}%")
        assert row is not None
        return int(row[0])

    def recorder_of(self, index: int) -> str:
        """The recorder that an episode was last leased, granted or committed to; empty if it was to none."""
        row = self._one("SELECT recorder FROM episode WHERE idx = ?", index)
        return str(row[0]) if row else ""

    def loads(self) -> dict[str, int]:
        """Episodes that are on their way to a recorder, by its name."""
        return dict(
            self._all(
                """SELECT recorder, count(*) FROM episode WHERE state IN ('leased', 'granted') AND stage = ?
                GROUP BY recorder""",
                self._stages[-1].name,
            )
        )

    def take_from(self, recorder: str) -> int:
        """Have others record what is on its way to a recorder and not durable; returns how many episodes that are."""
        rows = self._all(
            """UPDATE episode SET state = 'waiting', worker = ''
            WHERE state IN ('leased', 'granted') AND recorder = ? AND stage = ? RETURNING idx""",
            recorder,
            self._stages[-1].name,
        )
        return len(rows)

    def retire(self, recorder: str) -> int:
        """Give a recorder up with all that it has: its episodes are made again; returns how many those are."""
        with self.together():
            rows = self._all(
                """UPDATE episode SET state = 'waiting', worker = '', stage = ?
                WHERE state IN ('leased', 'granted', 'committed') AND recorder = ? RETURNING idx""",
                self._stages[0].name,
                recorder,
            )
            self._run("INSERT OR REPLACE INTO run VALUES (?, '')", _RETIRED + recorder)
        return len(rows)

    def retired(self) -> set[str]:
        """The recorders that were given up."""
        rows = self._all("SELECT key FROM run WHERE key LIKE ?", f"{_RETIRED}%")
        return {key.removeprefix(_RETIRED) for (key,) in rows}

    def holder(self, index: int, attempt: int) -> str:
        """The worker that holds an episode under this attempt; empty if none does."""
        row = self._one("SELECT worker FROM episode WHERE idx = ? AND attempt = ? AND state = 'leased'", index, attempt)
        return str(row[0]) if row else ""

    def expected(self, index: int, attempt: int) -> VerdictStatus:
        """OK if samples of this attempt may come, DONE if the episode is durable, else STALE."""
        row = self._one("SELECT state, attempt, stage FROM episode WHERE idx = ?", index)
        if row is None or row[0] == "rejected":
            return VerdictStatus.STALE
        if row[0] == "committed":
            return VerdictStatus.DONE
        held = row[0] in ("leased", "granted") and row[1:] == (attempt, self._stages[-1].name)
        return VerdictStatus.OK if held else VerdictStatus.STALE

    def grant(self, index: int, attempt: int, recorder: str) -> VerdictStatus:
        """Let a recorder make an episode durable: OK, STALE or DONE."""
        row = self._one(
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
        durable = self._held("SELECT idx FROM episode WHERE idx = ? AND state = 'committed'", index)
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
        with self.together():
            held = self._held(
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
            hashes = [row[0] for row in self._db.execute(unshared, (index, index))]
            self._db.execute("DELETE FROM result WHERE idx = ?", (index,))
        return hashes

    def take_back(self, index: int, recorder: str) -> bool:
        """Undo a grant whose episode did not become durable; False if the recorder does not hold one.

        What is left of its results are those of an attempt that was recorded: without them it is begun anew.
        """
        return self._held(
            """UPDATE episode SET state = 'waiting', worker = '',
            stage = CASE WHEN EXISTS (SELECT 1 FROM result WHERE result.idx = episode.idx) THEN stage ELSE ? END
            WHERE idx = ? AND state = 'granted' AND recorder = ? RETURNING idx""",
            self._stages[0].name,
            index,
            recorder,
        )

    def adopt(self, index: int, recorder: str, shard: str, samples: int, policy: str) -> None:
        """Note an episode as durable that a shard holds, whatever is known of it."""
        self._run("INSERT OR IGNORE INTO episode (idx, stage, state) VALUES (?, '', 'waiting')", index)
        self.commit(index, recorder, shard, samples, policy)

    def begin_rebuild(self) -> None:
        """Note that the ledger is being made anew, until `fill_gaps`: a kill in between leaves it `unfinished`."""
        self._run("INSERT OR REPLACE INTO run VALUES (?, '')", _REBUILDING)

    @property
    def unfinished(self) -> bool:
        """True if it knows of no episode, or not of all that its shards hold: it was being made anew."""
        known = self._one("SELECT 1 FROM episode LIMIT 1")
        return known is None or self._held("SELECT 1 FROM run WHERE key = ?", _REBUILDING)

    def fill_gaps(self, last: int, wanted: int) -> None:
        """Open the indices up to `last` that nothing is known of, and so end making a ledger anew.

        Some of them were rejected, and will be again: the run is not longer than `wanted` for that.
        """
        with self.together():
            self._db.executemany(
                "INSERT OR IGNORE INTO episode (idx, stage, state) VALUES (?, ?, 'waiting')",
                [(index, self._stages[0].name) for index in range(last + 1)],
            )
            if self.committed()[0] >= wanted:
                # A run has no more open indices than episodes: all others were rejected.
                self._run("UPDATE episode SET state = 'rejected', reason = ? WHERE state = 'waiting'", _FORGOTTEN)
            self._run("INSERT OR REPLACE INTO run VALUES (?, ?)", _REBUILT, str(wanted))
            self._run("DELETE FROM run WHERE key = ?", _REBUILDING)

    def check(self) -> None:
        """Raise RunError if the file is damaged."""
        row = self._one("PRAGMA quick_check(1)")
        if row != ("ok",):
            raise RunError(f"The run's ledger {self.path} is damaged: {row and row[0]}.")

    def shards(self) -> dict[str, dict[int, int]]:
        """Samples of every durable episode by its index, by the shard that it is in."""
        found: dict[str, dict[int, int]] = {}
        for shard, index, samples in self._all("SELECT shard, idx, samples FROM episode WHERE state = 'committed'"):
            found.setdefault(shard, {})[index] = samples
        return found

    def doubt(self, shard: str) -> None:
        """Have the recorder of a shard say again which of its episodes are durable."""
        self._run("UPDATE episode SET state = 'granted' WHERE state = 'committed' AND shard = ?", shard)

    def miss(self, indices: Sequence[int]) -> None:
        """Begin episodes anew that were durable and are no more."""
        with self.together():
            self._db.executemany(
                "UPDATE episode SET state = 'waiting', worker = '', stage = ? WHERE idx = ? AND state = 'committed'",
                [(self._stages[0].name, index) for index in indices],
            )

    def granted(self, recorder: str) -> tuple[int, ...]:
        """Indices granted to a recorder and not yet reported durable."""
        rows = self._all("SELECT idx FROM episode WHERE state = 'granted' AND recorder = ? ORDER BY idx", recorder)
        return tuple(row[0] for row in rows)

    def granted_recorders(self) -> set[str]:
        """Recorders that hold grants."""
        return {row[0] for row in self._all("SELECT DISTINCT recorder FROM episode WHERE state = 'granted'")}

    def requeue_expired(self, now_s: float) -> int:
        """End the leases whose time is over; returns how many."""
        return self._requeue("deadline_s < ?", now_s)

    def requeue_worker(self, worker: str) -> list[tuple[int, int]]:
        """End the leases of a worker that is gone; returns their indices, and how many workers each has outlived."""
        return self._all(
            """UPDATE episode SET state = 'waiting', worker = '', deaths = deaths + 1
            WHERE state = 'leased' AND worker = ? RETURNING idx, deaths""",
            worker,
        )

    def requeue_all(self) -> None:
        """End every lease: a new fleet starts on an old ledger."""
        self._requeue("true")

    def waiting(self) -> dict[str, int]:
        """Episodes that wait, by stage."""
        return dict(self._all("SELECT stage, count(*) FROM episode WHERE state = 'waiting' GROUP BY stage"))

    def waiting_at(self, stage: Stage) -> int:
        """Episodes that wait for a stage."""
        row = self._one("SELECT count(*) FROM episode WHERE state = 'waiting' AND stage = ?", stage.name)
        assert row is not None
        return int(row[0])

    def begun(self) -> int:
        """Episodes that wait or are held behind the first stage: those that were begun and are not done."""
        later = [stage.name for stage in self._stages[1:]]
        marks = ", ".join("?" * len(later))
        row = self._one(
            f"SELECT count(*) FROM episode WHERE state IN ('waiting', 'leased') AND stage IN ({marks})", *later
        )
        assert row is not None
        return int(row[0])

    def leases(self) -> list[tuple[str, str, int, int]]:
        """Worker, stage, index and attempt of every lease."""
        return self._all("SELECT worker, stage, idx, attempt FROM episode WHERE state = 'leased' ORDER BY idx")

    def leased(self) -> dict[str, int]:
        """Episodes that a worker holds, by stage."""
        return dict(self._all("SELECT stage, count(*) FROM episode WHERE state = 'leased' GROUP BY stage"))

    def rejections(self) -> dict[str, int]:
        """Rejected indices by reason."""
        return dict(
            self._all("SELECT reason, count(*) FROM episode WHERE state = 'rejected' GROUP BY reason ORDER BY reason")
        )

    def kept(self) -> dict[str, int]:
        """Episodes that a stage rejected and that go on or are durable nevertheless, by reason."""
        return dict(
            self._all(
                """SELECT reason, count(*) FROM episode WHERE state != 'rejected' AND reason != ''
                GROUP BY reason ORDER BY reason"""
            )
        )

    def rejected(self) -> dict[int, str]:
        """Reason of every rejected index, by index."""
        return dict(self._all("SELECT idx, reason FROM episode WHERE state = 'rejected' ORDER BY idx"))

    def committed(self) -> tuple[int, int]:
        """Durable episodes, and the samples in them."""
        row = self._one("SELECT episodes, samples FROM durable")
        assert row is not None
        return int(row[0]), int(row[1])

    def results(self) -> set[str]:
        """Hashes of all results that are still needed."""
        return {row[0] for row in self._all("SELECT sha256 FROM result")}

    def offer(self, policy: PolicyRef, wall_ns: int) -> OfferedPolicy:
        """Note that a policy was offered; files that are known already stay what they are, and as old."""
        files = json.dumps([[file.path, file.sha256, file.size] for file in policy.files])
        with self.together():
            self._db.execute(
                """INSERT OR IGNORE INTO policy (sha256, files, samples, wall_ns)
                VALUES (?, ?, (SELECT coalesce(sum(samples), 0) FROM episode WHERE state = 'committed'), ?)""",
                (policy.sha256, files, wall_ns),
            )
        return next(offered for offered in self.policies() if offered.sha256 == policy.sha256)

    def policies(self) -> tuple[OfferedPolicy, ...]:
        """All policies that were offered, the oldest first."""
        rows = self._all("SELECT version, sha256, files, samples, wall_ns FROM policy ORDER BY version")
        return tuple(
            OfferedPolicy(
                version=version,
                sha256=sha256,
                files=tuple(FileRef(path=path, sha256=digest, size=size) for path, digest, size in json.loads(files)),
                samples=samples,
                wall_ns=wall_ns,
            )
            for version, sha256, files, samples, wall_ns in rows
        )

    def idle_policy_files(self) -> set[str]:
        """Hashes of the files of offered policies that no episode names, the newest policy's not among them.

        An episode names the policy that drove it, that comes with its lease or that is assigned to it.
        """
        named = {
            row[0]
            for row in self._all(
                """SELECT CASE state WHEN 'committed' THEN driven_by ELSE policy END FROM episode
                UNION SELECT assigned FROM episode"""
            )
        }
        *older, newest = self.policies()
        idle = [policy for policy in older if policy.sha256 not in named]
        needed = [newest, *(policy for policy in older if policy.sha256 in named)]
        return _files_of(idle) - _files_of(needed)

    def driven_by(self) -> dict[int, str]:
        """The offered policy that drove, empty for none, of every durable episode by its index."""
        return dict(self._all("SELECT idx, driven_by FROM episode WHERE state = 'committed' ORDER BY idx"))

    def assign(self, policies: Mapping[int, str]) -> None:
        """Open exactly these indices, each for the policy that shall drive it; empty is for none of the offered ones.

        Indices that are open already stay as they are.
        """
        with self.together():
            self._db.executemany(
                "INSERT OR IGNORE INTO episode (idx, stage, state, assigned) VALUES (?, ?, 'waiting', ?)",
                [(index, self._stages[0].name, sha256) for index, sha256 in policies.items()],
            )

    def add(self, counter: str, amount: float) -> None:
        """Add to a counter."""
        self._run(
            "INSERT INTO counter VALUES (?, ?) ON CONFLICT (name) DO UPDATE SET value = value + excluded.value",
            counter,
            amount,
        )

    def counters(self) -> dict[str, float]:
        """All counters."""
        return dict(self._all("SELECT name, value FROM counter"))

    def _requeue(self, condition: str, *values: object) -> int:
        statement = (
            f"UPDATE episode SET state = 'waiting', worker = '' WHERE state = 'leased' AND {condition} RETURNING 1"
        )
        return len(self._all(statement, *values))

    @contextmanager
    def together(self) -> Iterator[None]:
        """Do what the block does in one transaction, all of it or nothing: each costs more than what it writes."""
        with self._lock:
            if self._db.in_transaction:
                yield
                return
            try:
                with self._db:
                    self._db.execute("BEGIN IMMEDIATE")
                    yield
            except sqlite3.Error as error:
                raise self._worded(error) from error

    def _worded(self, error: sqlite3.Error) -> RunError:
        # The lower byte of an extended code is the plain one.
        later = getattr(error, "sqlite_errorcode", 0) & 0xFF in _DISK_CODES
        return (DiskError if later else RunError)(
            f"The run's ledger {self.path} cannot be used: {error}; if the disk is full, free some space and run "
            "the same command again, else record into a new folder."
        )

    def _held(self, statement: str, *values: object) -> bool:
        return self._one(statement, *values) is not None

    def _one(self, statement: str, *values: object) -> tuple[Any, ...] | None:
        rows = self._all(statement, *values)
        return rows[0] if rows else None

    def _all(self, statement: str, *values: object) -> list[tuple[Any, ...]]:
        with self._lock:
            try:
                return self._db.execute(statement, values).fetchall()
            except sqlite3.Error as error:
                raise self._worded(error) from error

    def _run(self, statement: str, *values: object) -> None:
        self._all(statement, *values)
