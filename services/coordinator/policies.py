"""The policies that were offered to a run that learns."""

import json
from collections.abc import Sequence
from dataclasses import dataclass

from readygo.common.documents import parse_json
from readygo.common.messages import FileRef, PolicyRef
from readygo.services.coordinator.database import Database


@dataclass(frozen=True, kw_only=True)
class OfferedPolicy:
    """A policy that was offered to the run."""

    version: int
    """From 1, in the order of the offers."""
    sha256: str
    """SHA-256 of the policy, see `PolicyRef.sha256`."""
    files: tuple[FileRef, ...]
    samples: int
    """Durable samples when it was offered."""
    wall_ns: int
    """When it was offered, by the wall clock [ns]."""


class Policies:
    """The table `policy` of a ledger."""

    def __init__(self, database: Database) -> None:
        """Read and write this table of a database."""
        self._database = database

    def offer(self, policy: PolicyRef, wall_ns: int) -> OfferedPolicy:
        """Note that a policy was offered; files that are known already stay what they are, and as old."""
        files = json.dumps([[file.path, file.sha256, file.size] for file in policy.files])
        with self._database.together():
            self._database.run(
                """INSERT OR IGNORE INTO policy (sha256, files, samples, wall_ns)
                VALUES (?, ?, (SELECT coalesce(sum(samples), 0) FROM episode WHERE state = 'committed'), ?)""",
                policy.sha256,
                files,
                wall_ns,
            )
        return next(offered for offered in self.all() if offered.sha256 == policy.sha256)

    def all(self) -> tuple[OfferedPolicy, ...]:
        """All policies that were offered, the oldest first."""
        rows = self._database.all("SELECT version, sha256, files, samples, wall_ns FROM policy ORDER BY version")
        return tuple(
            OfferedPolicy(
                version=version,
                sha256=sha256,
                files=tuple(FileRef(path=path, sha256=digest, size=size) for path, digest, size in parse_json(files)),
                samples=samples,
                wall_ns=wall_ns,
            )
            for version, sha256, files, samples, wall_ns in rows
        )

    def idle_files(self) -> set[str]:
        """Hashes of the files of offered policies that no episode names, the newest policy's not among them.

        An episode names the policy that drove it, that comes with its lease or that is assigned to it.
        """
        named = {
            row[0]
            for row in self._database.all(
                """SELECT CASE state WHEN 'committed' THEN driven_by ELSE policy END FROM episode
                UNION SELECT assigned FROM episode"""
            )
        }
        *older, newest = self.all()
        idle = [policy for policy in older if policy.sha256 not in named]
        needed = [newest, *(policy for policy in older if policy.sha256 in named)]
        return _files_of(idle) - _files_of(needed)


def _files_of(policies: Sequence[OfferedPolicy]) -> set[str]:
    return {file.sha256 for policy in policies for file in policy.files}
