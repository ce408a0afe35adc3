"""The run's ledger: which episode is at which stage, who holds it, and under which attempt.

One SQLite file (write-ahead log). Episodes are the rows; a run of N episodes always has exactly N rows that are not
rejected, opened in the order of their indices, so the committed ones are the N smallest accepted indices and nothing is
ever made in vain. `protocol` has the rules; this module applies them in transactions.
"""

from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path

from readygo.common.messages import Stage, VerdictStatus
from readygo.common.messages.stages import EXPERT_LINE
from readygo.services.coordinator.census import Census
from readygo.services.coordinator.database import Database
from readygo.services.coordinator.episodes import Episodes
from readygo.services.coordinator.notes import Notes
from readygo.services.coordinator.policies import Policies
from readygo.services.coordinator.protocol import NO_HOLDER, EpisodeRow, Holder, Protocol, StageState, Written


@dataclass(frozen=True, kw_only=True)
class Lease:
    """A claim on one stage of one episode."""

    index: int
    attempt: int
    inputs: tuple[str, ...]
    """Hashes of the results that the stage needs, in the order of `Stage.needs`."""
    policy: str = ""
    """The offered policy that comes with it, for a stage that records; empty without any."""


_FORGOTTEN = "rejected before the ledger was rebuilt"
_REBUILDING = "rebuilding"
_REBUILT = "rebuilt"
"""Key of the length that a run was to have when its ledger was rebuilt."""
_RETIRED = "retired/"
"""Prefix of the key of a recorder that was given up."""


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
        self._protocol = Protocol(stages)
        self._episodes = Episodes(self._database)
        self.census = Census(self._database, stages)
        """What may be asked of the episodes."""
        self.policies = Policies(self._database)
        """Policies that trainers offered."""
        self.notes = Notes(self._database)
        """Values and counters of the run as a whole."""

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
            self._episodes.open(range(following, following + missing), self._protocol.first)
        return missing

    def drop_episodes(self, wanted: int) -> None:
        """Forget the indices behind the `wanted` smallest ones that are not rejected: the run was to be longer.

        Nothing is forgotten where an index behind them is durable. A rebuilt ledger may have many such indices: it does
        not know yet which earlier ones were rejected.
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

    def claim(self, stage: Stage, holder: Holder, deadline_s: float, recorder: str = "") -> Lease | None:
        """Lease the waiting episode of smallest index at `stage`, if there is one, to be given to a recorder.

        With the stage that records comes the policy that is assigned to the episode, else the newest one.
        """
        with self._database.together():
            episode = self._episodes.first_waiting(stage.name)
            leased = episode and self._protocol.lease(episode, holder, recorder)
            if not leased:
                return None
            self._episodes.store(leased)
            policy = self._episodes.begin_lease(leased.index, deadline_s, with_policy=stage.records)
            results = self._results(leased.index)
        inputs = tuple(results[name] for name in stage.needs)
        return Lease(index=leased.index, attempt=leased.attempt, inputs=inputs, policy=policy)

    def renew(self, index: int, attempt: int, deadline_s: float) -> bool:
        """Prolong a lease; False if the attempt does not hold it any more."""
        return self._episodes.renew(index, attempt, deadline_s)

    def advance(self, stage: Stage, index: int, attempt: int, sha256: str, *, reason: str = "") -> bool:
        """Store a stage's result and pass the episode on; False if the attempt does not hold the lease.

        A `reason` says that the stage rejected the episode, which is kept nevertheless.
        """
        with self._database.together():
            held = self._change(index, lambda episode: self._protocol.advance(episode, stage.name, attempt, reason))
            if held:
                self._database.run("INSERT OR REPLACE INTO result VALUES (?, ?, ?)", index, stage.name, sha256)
        return held is not None

    def reject(self, stage: Stage, index: int, attempt: int, reason: str) -> bool:
        """Skip an index for good; False if the attempt does not hold the lease."""
        rejected = self._change(index, lambda episode: self._protocol.reject(episode, stage.name, attempt, reason))
        return rejected is not None

    def fail(self, stage: Stage, index: int, attempt: int) -> int | None:
        """Begin an episode again after a worker's error; returns its failures so far, None if not held."""
        failed = self._change(index, lambda episode: self._protocol.fail(episode, stage.name, attempt))
        return failed.failures if failed else None

    def restart(self, index: int) -> None:
        """Have an episode pass all stages again that waits or that a worker holds."""
        self._change(index, self._protocol.restart)

    def set_aside(self, index: int, reason: str) -> dict[str, str]:
        """Give up an episode that waits; the next index takes its place.

        Returns:
            Hashes of the results that it came to, by stage.
        """
        with self._database.together():
            results = self._results(index)
            self._change(index, lambda episode: self._protocol.set_aside(episode, reason))
            self._database.run("DELETE FROM result WHERE idx = ?", index)
        return results

    def take_from(self, recorder: str) -> int:
        """Have others record what is on its way to a recorder and not durable; returns how many episodes that are."""
        return self._change_each(
            self._episodes.of_recorder(recorder),
            lambda episode: self._with_results(self._protocol.take_from(episode, recorder)),
        )

    def retire(self, recorder: str) -> int:
        """Give a recorder up with all that it has: its episodes are made again; returns how many those are."""
        with self._database.together():
            count = self._change_each(
                self._episodes.of_recorder(recorder), lambda episode: self._protocol.retire(episode, recorder)
            )
            self.notes.put(_RETIRED + recorder)
        return count

    def retired_recorders(self) -> set[str]:
        """The recorders that were given up."""
        return self.notes.keys(_RETIRED)

    def grant(self, index: int, attempt: int, recorder: str) -> VerdictStatus:
        """Let a recorder make an episode durable: OK, STALE or DONE."""
        with self._database.together():
            episode = self._episodes.get(index)
            if episode is None:
                return VerdictStatus.STALE
            granted, verdict = self._protocol.grant(episode, recorder, attempt)
            if granted:
                self._episodes.store(granted)
        return verdict

    def commit(self, index: int, written: Written) -> list[str] | None:
        """Note that an episode is durable.

        Returns:
            Hashes of results that are not needed any more; None if the episode was not granted to this recorder under
            this attempt.
        """
        return self._commit(index, lambda episode: self._protocol.commit(episode, written))

    def append_verdict(self, index: int, attempt: int) -> VerdictStatus:
        """OK if samples of this attempt may come, DONE if the episode is durable, else STALE."""
        episode = self._episodes.get(index)
        return self._protocol.append_verdict(episode, attempt) if episode else VerdictStatus.STALE

    def holder(self, index: int, attempt: int) -> Holder:
        """The worker that holds an episode under this attempt; `NO_HOLDER` if none does."""
        episode = self._episodes.get(index)
        return episode.holder if episode and self._protocol.holds(episode, attempt) else NO_HOLDER

    def completes(self, stage: Stage, index: int, attempt: int) -> bool:
        """True if a worker may report on this attempt: it holds the episode, or held it until a recorder took over."""
        episode = self._episodes.get(index)
        return episode is not None and self._protocol.completes(episode, stage.name, attempt)

    def take_back(self, index: int, recorder: str, attempt: int) -> bool:
        """Undo a grant whose episode did not become durable; False if the recorder does not hold one."""
        taken = self._change(
            index, lambda episode: self._with_results(self._protocol.take_back(episode, recorder, attempt))
        )
        return taken is not None

    def adopt(self, index: int, written: Written) -> None:
        """Mark an episode of a finished shard as durable, regardless of its state in the ledger."""
        self._episodes.open([index], self._protocol.first)
        self._commit(index, lambda episode: self._protocol.adopt(episode, written))

    def entrust(self, index: int, recorder: str) -> None:
        """Have a recorder report on an episode that its open shard seems to hold, regardless of the ledger."""
        self._episodes.open([index], self._protocol.first)
        self._change(index, lambda episode: self._protocol.entrust(episode, recorder))

    def begin_rebuild(self) -> None:
        """Note that a rebuild of the ledger began, until `fill_gaps`: a kill in between leaves it `unfinished`."""
        self.notes.put(_REBUILDING)

    @property
    def unfinished(self) -> bool:
        """True if the ledger knows of no episode, or a rebuild from the shards was interrupted."""
        return not self._database.has_row("SELECT 1 FROM episode LIMIT 1") or _REBUILDING in self.notes

    def fill_gaps(self, last: int, wanted: int) -> None:
        """Open the indices up to `last` that the ledger does not know, and end its rebuild.

        Some of them were rejected, and will be again: the run is not longer than `wanted` for that.
        """
        with self._database.together():
            self._episodes.open(range(last + 1), self._protocol.first)
            if self.census.committed_counts()[0] >= wanted:
                # A run has no more open indices than episodes: all others were rejected.
                self._database.run(
                    "UPDATE episode SET state = 'rejected', reason = ? WHERE state = 'waiting'", _FORGOTTEN
                )
            self.notes.put(_REBUILT, str(wanted))
            self.notes.drop(_REBUILDING)

    def doubt(self, shard: str) -> None:
        """Have the recorder of a shard say again which of its episodes are durable."""
        self._change_each(self._episodes.in_shard(shard), self._protocol.doubt)

    def miss(self, indices: Sequence[int]) -> None:
        """Restart episodes that were durable and whose shards are lost."""
        episodes = [episode for index in indices if (episode := self._episodes.get(index))]
        durable = [episode for episode in episodes if episode.state is StageState.COMMITTED]
        self._change_each(durable, self._protocol.forget)

    def requeue_expired(self, now_s: float) -> int:
        """End the leases whose time is over; returns how many."""
        return self._change_each(self._episodes.leased_episodes(before_s=now_s), self._protocol.expire)

    def requeue_holder(self, holder: Holder) -> list[tuple[int, int]]:
        """End the leases of a worker's life that ended.

        Returns:
            Their indices, and how many holders each has outlived at its stage.
        """
        with self._database.together():
            ended = [
                lost for lease in self._episodes.held_by(holder) if (lost := self._protocol.lose_holder(lease, holder))
            ]
            for episode in ended:
                self._episodes.store(episode)
        return [(episode.index, episode.deaths) for episode in ended]

    def requeue_all(self) -> None:
        """End every lease: a new fleet starts on an old ledger."""
        self._change_each(self._episodes.leased_episodes(), self._protocol.expire)

    def assign(self, policies: Mapping[int, str]) -> None:
        """Open exactly these indices, each for the policy that shall drive it; empty is for none of the offered ones.

        Indices that are open already stay as they are.
        """
        self._episodes.open(policies, self._protocol.first, assigned=policies)

    def _commit(self, index: int, rule: Callable[[EpisodeRow], EpisodeRow | None]) -> list[str] | None:
        with self._database.together():
            if self._change(index, rule) is None:
                return None
            # Episodes whose results are equal share the blob.
            unshared = """SELECT DISTINCT sha256 FROM result WHERE idx = ?
                AND sha256 NOT IN (SELECT sha256 FROM result WHERE idx != ?)"""
            hashes = [row[0] for row in self._database.all(unshared, index, index)]
            self._database.run("DELETE FROM result WHERE idx = ?", index)
        return hashes

    def _with_results(self, episode: EpisodeRow | None) -> EpisodeRow | None:
        """An episode that waits for its last stage again: at the first one if its results were dropped meanwhile."""
        if episode is None or self._results(episode.index):
            return episode
        return self._protocol.forget(episode)

    def _results(self, index: int) -> dict[str, str]:
        return dict(self._database.all("SELECT stage, sha256 FROM result WHERE idx = ?", index))

    def _change(self, index: int, rule: Callable[[EpisodeRow], EpisodeRow | None]) -> EpisodeRow | None:
        """Apply a rule to an episode; the changed one, None where the rule refuses or the index is not open."""
        with self._database.together():
            episode = self._episodes.get(index)
            changed = rule(episode) if episode else None
            if changed:
                self._episodes.store(changed)
        return changed

    def _change_each(self, episodes: Sequence[EpisodeRow], rule: Callable[[EpisodeRow], EpisodeRow | None]) -> int:
        """Apply a rule to episodes; returns how many it changed."""
        with self._database.together():
            changed = [after for before in episodes if (after := rule(before))]
            for episode in changed:
                self._episodes.store(episode)
        return len(changed)
